"""Writes the C functions that evaluate one stage of an optimal control problem.

They compute its values, Jacobian and Hessian.
"""

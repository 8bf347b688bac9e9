"""Brings an optimal control problem into the form of its solver: staged or condensed.

Staged solves by a Riccati recursion over the stages; condensed eliminates the states.
"""

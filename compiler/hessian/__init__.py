"""Derives value, Jacobian and Hessian of one step together, as core operations."""

"""Derives one graph that computes value, Jacobian and Hessian of one step."""

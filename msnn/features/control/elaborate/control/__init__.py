"""Lowers the `mpc` section: a spec to the optimal control problem of its controller."""

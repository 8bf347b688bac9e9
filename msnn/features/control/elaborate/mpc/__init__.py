"""Makes the optimal control problem of a spec from its `mpc` section."""

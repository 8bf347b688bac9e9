"""Predictive control and state estimation: the sections `mpc` and `estimator`, their exports."""

"""Makes the problems of the sections `mpc` and `estimator` from the compiled spec."""

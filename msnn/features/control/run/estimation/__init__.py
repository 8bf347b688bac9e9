"""The moving-horizon estimator in Python, with the solvers of controllers."""

"""Controllers and moving-horizon estimators in Python, by their C or by the reference solver."""

"""Controllers and estimators that run in Python, by their C or by the reference solver."""

"""The problem of an estimator as data: states, parameters, measurements and their variances."""

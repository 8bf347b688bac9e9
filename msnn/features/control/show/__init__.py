"""The tables of `msnn show` about controllers and estimators."""

"""Finds what rounding alone may change, so that only the rest counts as a fault."""

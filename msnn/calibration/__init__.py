"""Completes what calibration tools read of an export by what was built from it."""

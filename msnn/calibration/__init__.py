"""Completes the description for calibration tools with addresses from the built program."""

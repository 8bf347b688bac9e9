"""Writes and completes ASAP2 files (A2L 1.7.1): what calibration tools know of generated C."""

"""Writes and completes ASAP2 files (A2L 1.7.1), which describe generated C to calibration tools."""

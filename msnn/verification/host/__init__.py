"""Checks exported C on this machine: builds, golden runs, coverage, fuzzing."""

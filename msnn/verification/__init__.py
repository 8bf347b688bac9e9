"""Verifies exported C: strict builds, runs on the host and in QEMU, analysis, fuzzing, report."""

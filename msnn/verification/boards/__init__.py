"""Runs exported C bare-metal in QEMU."""

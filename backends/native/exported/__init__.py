"""Compiles exported C for this machine and calls it from Python."""

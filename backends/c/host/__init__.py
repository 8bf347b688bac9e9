"""Builds exported C on this machine and calls it from Python."""

"""Trains by native kernels, each checked when it is built."""

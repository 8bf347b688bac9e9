"""Trains with native kernels, each checked after it is built."""

"""Arranges what a kernel computes: when it can run, and what is summed together."""

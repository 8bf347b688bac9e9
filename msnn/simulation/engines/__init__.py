"""Runs rollouts in the reference interpreter, in native kernels or in torch."""

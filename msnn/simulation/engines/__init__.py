"""Runs rollouts: in the interpreter, in native kernels, in torch."""

"""Turns a Spec into a typed Program: names, dims, units, time, passes and the interpreter."""

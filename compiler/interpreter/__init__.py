"""Runs programs with numpy: the meaning that every backend must agree with."""

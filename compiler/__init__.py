"""Compiles a `Spec` (parsed YAML) to a `Program` (the typed intermediate representation): resolves
names, dimensions, units and time, runs the passes, and contains the reference interpreter.
"""

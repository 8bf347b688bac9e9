"""Mutated specs: no mistake of a user may ever show a traceback."""

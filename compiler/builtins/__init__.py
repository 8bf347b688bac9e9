"""Lowers calls of the builtin functions of the language."""

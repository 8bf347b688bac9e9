"""Lowers the expressions of a spec to nodes of the program's graphs."""

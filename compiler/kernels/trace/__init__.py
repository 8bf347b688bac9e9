"""Records the arithmetic of a kernel's Python function as statements (tracing), and evaluates or
simplifies them.
"""

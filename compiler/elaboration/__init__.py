"""Compiles a linked spec to a program: lowers every entry, once for each time at which it
is read.
"""

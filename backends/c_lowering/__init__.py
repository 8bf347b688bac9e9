"""Translates graphs of a program to the tree of C."""

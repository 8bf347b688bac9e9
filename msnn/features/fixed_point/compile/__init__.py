"""Compiles a program to integers, and bounds the error that one step adds."""

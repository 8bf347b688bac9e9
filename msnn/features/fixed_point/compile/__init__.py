"""Compiles a program to integers, and bounds what a step adds to the errors."""

"""Writes a program as a torch module and as a file that needs only torch."""

"""Writes a program as CasADi functions with named ports."""

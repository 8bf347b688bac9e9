"""Lowers the functions that every spec has."""

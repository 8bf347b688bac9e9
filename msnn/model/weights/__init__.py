"""Reads, checks and saves weights."""

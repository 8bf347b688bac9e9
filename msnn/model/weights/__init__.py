"""Reads, checks and keeps weights."""

"""Writes files completely or not at all, and finds and runs a C compiler."""

"""Checks exported controllers and filters: golden solves, sanitizers, drawn numbers, emulators."""

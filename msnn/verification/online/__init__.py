"""Verifies exported controllers and filters: golden solves, drawn numbers, boards."""

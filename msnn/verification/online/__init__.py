"""Verifies exported controllers and filters: golden solves, random inputs, boards."""

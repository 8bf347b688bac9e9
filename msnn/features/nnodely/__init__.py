"""Reads models that other tools saved and writes them as specs and weights."""

"""Serves editors: the JSON Schema, the docs of keys, the format of specs."""

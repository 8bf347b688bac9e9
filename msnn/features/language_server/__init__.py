"""Serves editors: diagnostics, hover, definitions, completion and quick fixes."""

"""Answers editors: diagnostics, hover, definitions, completion and repairs while one types."""

"""Reads tables of text: CSV, and workbooks as if saved as text."""

"""Reads the columns of data files; one module per format."""

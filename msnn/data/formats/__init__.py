"""Reads the columns of data files, one format a file."""

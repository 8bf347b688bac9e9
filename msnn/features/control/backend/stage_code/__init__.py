"""Writes the functions of a stage in C: values, slopes, curvature."""

"""Writes a run as one page: plots, tables, formulas, and the model itself as WebAssembly."""

"""Writes a run as one page: pictures, tables, formulas, and the model itself as WebAssembly."""

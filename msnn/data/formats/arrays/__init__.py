"""Reads files of named arrays: MAT, HDF5, NPZ, Parquet."""

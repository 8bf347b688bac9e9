"""Translates math kernels to C, and writes them as a header and a source file."""

"""Lowers the traced math kernels to the C tree, and writes the two files that an export has."""

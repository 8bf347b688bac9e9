"""Writes what stands beside the code in an exported folder: header, build files, packages, FFI."""

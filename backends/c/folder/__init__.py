"""Writes the other files of an exported folder: header, build files, packages, FFI."""

"""Writes the files of an exported folder around the C functions: header, build files, packages,
FFI.
"""

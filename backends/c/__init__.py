"""Writes a program as C99: a step function with its states in a struct, for microcontrollers and
PCs.
"""

from backends.c.folder.file_texts import write_c
from backends.c_lowering.options import COptions

__all__ = ["COptions", "write_c"]

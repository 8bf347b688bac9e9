"""Writes the C of a model: a folder that builds by itself."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from numpy.typing import ArrayLike

from backends.c.folder.file_texts import file_texts
from backends.c.interface.interface import c_interface
from backends.c_lowering.options import COptions
from backends.files.atomic_write import write_text
from compiler.interpreter.interpreter import physical_weights
from compiler.ir.program import Program

_DEFAULT_OPTIONS = COptions()


def write_c(
    program: Program,
    weights: Mapping[str, ArrayLike],
    folder: Path,
    options: COptions = _DEFAULT_OPTIONS,
) -> tuple[Path, ...]:
    """Writes header, sources, self-test, build file and README; returns their paths.

    `program` is in step form, its losses are left out. `weights` are physical arrays by name, a
    missing one is the parameter's initial value. The same arguments give the same bytes. Raises
    ValueError for a program in window form or weights of a wrong shape, OSError.
    """
    interface = c_interface(program, options)
    # all texts first: a model that cannot be lowered leaves no half of a folder behind
    texts = file_texts(program, interface, physical_weights(program, weights))
    return tuple(write_text(folder / name, text) for name, text in texts.items())

"""Writes a fixed-point C export: a folder that builds without other files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from backends.files.atomic_write import write_text
from compiler.interpreter.interpreter import physical_weights
from compiler.ir.program import Program
from msnn.features.fixed_point.backend.file_texts import file_texts
from msnn.features.fixed_point.backend.measured_errors import measured_errors
from msnn.features.fixed_point.compile.compile_integers import integer_program
from msnn.features.fixed_point.deviation.deviation import OutputError
from msnn.features.fixed_point.integers.program import WIDTHS


@dataclass(frozen=True, slots=True)
class FixedExport:
    """The written files, and the errors against float64."""

    files: tuple[Path, ...]
    errors: tuple[OutputError, ...]


def write_fixed_c(
    program: Program, weights: Mapping[str, ArrayLike], folder: Path, prefix: str, dtype: str
) -> FixedExport:
    """Writes header, sources, self-test, build file and README.

    `program` is in step form; `dtype` is `q15` or `q31`. The same arguments give the same bytes.
    Raises SpecError for values that fixed point cannot represent, and OSError.
    """
    numbers: dict[str, Any] = physical_weights(program, weights)
    integers = integer_program(program, numbers, WIDTHS[dtype])
    with np.errstate(all="ignore"):
        errors = measured_errors(program, numbers, integers)
    texts = file_texts(integers, prefix, errors)
    files = tuple(write_text(folder / name, text) for name, text in texts.items())
    return FixedExport(files, errors)

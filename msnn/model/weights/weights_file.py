"""Saves weights to disk: a safetensors file with each parameter's physical float64 array."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from backends.files.atomic_write import write_bytes
from backends.files.safetensors_bytes import safetensors_bytes
from compiler.ir.program import Program
from msnn.data.dataset import FloatArray
from msnn.errors.learning import weights as weight_errors
from msnn.model.weights.checked_weights import checked_weights
from msnn.model.weights.safetensors_file import WeightsFault, arrays_in
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.reading.reader import refuse_endless


def initial_weights(program: Program) -> dict[str, FloatArray]:
    """The initial value of every parameter, in its shape."""
    return {
        parameter.name: np.array(parameter.initial, dtype=np.float64).reshape(
            tuple(axis.size for axis in parameter.axes)
        )
        for parameter in program.parameters
    }


def write_weights(
    path: Path, weights: Mapping[str, FloatArray], program: Program, *, named_later: bool = False
) -> Path:
    """Writes the arrays with the program's name, spec hash and units as metadata; durably.

    `named_later` is that of `write_bytes`, for who trains again what a cut of power took.
    """
    units = {p.name: p.unit.text for p in program.parameters if p.unit is not None}
    metadata = {
        "format": "msnn-weights-1",
        "program": program.name,
        "spec_sha256": program.spec_hash,
        "units": json.dumps(units, ensure_ascii=False, sort_keys=True),
    }
    arrays = {name: np.asarray(value, np.float64) for name, value in weights.items()}
    content = safetensors_bytes(arrays, metadata)
    # hours of training lie in it
    return write_bytes(path, content, durable=True, named_later=named_later)


def read_weights(path: Path, program: Program) -> dict[str, FloatArray]:
    """The weights of a program in a file. Raises SpecError with all errors (rule R12)."""
    shown = str(path)
    try:
        refuse_endless(path)
        arrays = arrays_in(path.read_bytes())
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise SpecError((weight_errors.unreadable_weights(shown, reason),)) from error
    except WeightsFault as fault:
        raise SpecError((weight_errors.unreadable_weights(shown, str(fault)),)) from fault
    return checked_weights(program, arrays, shown)

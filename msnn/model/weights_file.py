"""Weights on disk: a safetensors file with the physical float64 array of every parameter."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from backends.files.atomic_write import write_bytes
from backends.files.safetensors_bytes import safetensors_bytes
from compiler.ir.program import Program
from msnn.data.dataset import FloatArray
from msnn.errors import training as errors
from msnn.errors import weights as weight_errors
from msnn.model.safetensors_file import arrays_in
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError


@dataclass(frozen=True, slots=True)
class LoadedWeights:
    """The array of every parameter, and what is to be said about the file."""

    weights: dict[str, FloatArray]
    warnings: tuple[Diagnostic, ...]


def initial_weights(program: Program) -> dict[str, FloatArray]:
    """The initial value of every parameter, in its shape."""
    return {
        parameter.name: np.array(parameter.initial, dtype=np.float64).reshape(
            tuple(axis.size for axis in parameter.axes)
        )
        for parameter in program.parameters
    }


def known_weights(
    program: Program, weights: Mapping[str, FloatArray] | None
) -> Mapping[str, FloatArray]:
    """The weights, by default the initial values; SpecError where those are not known (R12)."""
    if weights is not None:
        return weights
    unknown = [p for p in program.parameters if p.statistic is not None]
    if unknown:
        names = [parameter.name for parameter in unknown]
        raise SpecError((errors.unknown_statistics(names, unknown[0].span),))
    return initial_weights(program)


def write_weights(path: Path, weights: Mapping[str, FloatArray], program: Program) -> Path:
    """Writes the arrays with the program's name, spec hash and units as metadata; durably."""
    units = {p.name: p.unit.text for p in program.parameters if p.unit is not None}
    metadata = {
        "format": "msnn-weights-1",
        "program": program.name,
        "spec_sha256": program.spec_hash,
        "units": json.dumps(units, ensure_ascii=False, sort_keys=True),
    }
    arrays = {name: np.asarray(value, np.float64) for name, value in weights.items()}
    return write_bytes(path, safetensors_bytes(arrays, metadata), durable=True)


def read_weights(path: Path, program: Program) -> LoadedWeights:
    """The weights of a program (rule R12).

    A missing name, a wrong shape, values that are no floating point numbers and a value that is
    not finite are errors, raised together as SpecError; extra names are a warning.
    """
    shown = str(path)
    try:
        arrays = arrays_in(path.read_bytes())
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise SpecError((weight_errors.unreadable_weights(shown, reason),)) from error
    if arrays is None:
        reason = "it is not a safetensors file"
        raise SpecError((weight_errors.unreadable_weights(shown, reason),))
    faults: list[Diagnostic] = []
    missing = [p.name for p in program.parameters if p.name not in arrays]
    if missing:
        faults.append(weight_errors.missing_weights(shown, missing))
    found: dict[str, FloatArray] = {}
    for parameter in program.parameters:
        shape = tuple(axis.size for axis in parameter.axes)
        array = arrays.get(parameter.name)
        if array is not None and array.shape != shape:
            faults.append(
                weight_errors.misshapen_weights(
                    shown, parameter.name, array.shape, shape, parameter.span
                )
            )
        elif array is not None and not np.issubdtype(array.dtype, np.floating):
            faults.append(
                weight_errors.weights_not_floating(shown, parameter.name, str(array.dtype))
            )
        elif array is not None:
            found[parameter.name] = array.astype(np.float64)
    wild = [name for name, array in found.items() if not np.all(np.isfinite(array))]
    if wild:
        faults.append(weight_errors.weights_not_finite(shown, wild))
    if faults:
        raise SpecError(faults)
    extra = sorted(set(arrays) - set(found))
    return LoadedWeights(found, (weight_errors.extra_weights(shown, extra),) if extra else ())

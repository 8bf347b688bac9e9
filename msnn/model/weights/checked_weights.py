"""Checks arrays against the parameters of a model, wherever they come from."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compiler.ir.program import Parameter, Program
from msnn.data.dataset import FloatArray
from msnn.errors.learning import weights as errors
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError

_ROUNDING = float(np.finfo(np.float32).eps)

GIVEN = "the given mapping of weights"
"""Origin of weights in messages if they are not from a file."""


def checked_weights(
    program: Program, arrays: Mapping[str, NDArray[Any]], origin: str
) -> dict[str, FloatArray]:
    """The arrays of all parameters; SpecError with all errors. `origin` names them in messages."""
    faults: list[Diagnostic] = []
    known = [parameter.name for parameter in program.parameters]
    unknown = [name for name in arrays if name not in known]
    if unknown:
        faults.append(errors.unknown_weights(origin, unknown, known))
    missing = [name for name in known if name not in arrays]
    if missing:
        faults.append(errors.missing_weights(origin, missing, given=origin == GIVEN))
    found: dict[str, FloatArray] = {}
    for parameter in program.parameters:
        shape = tuple(axis.size for axis in parameter.axes)
        name, array = parameter.name, arrays.get(parameter.name)
        if array is None:
            continue
        if array.shape != shape:
            faults.append(
                errors.misshapen_weights(origin, name, array.shape, shape, parameter.span)
            )
        # a cast would take bits, texts and complex numbers without a word
        elif not np.issubdtype(array.dtype, np.floating):
            faults.append(errors.weights_not_floating(origin, name, str(array.dtype)))
        else:
            found[name] = array.astype(np.float64)
    wild = [name for name, array in found.items() if not np.all(np.isfinite(array))]
    if wild:
        faults.append(errors.weights_not_finite(origin, wild))
    for parameter in program.parameters:
        outside = _outside(parameter, found.get(parameter.name))
        if outside is not None:
            faults.append(errors.weights_outside_bounds(origin, parameter, outside))
    if faults:
        raise SpecError(faults)
    return found


def _outside(parameter: Parameter, array: FloatArray | None) -> float | None:
    """The value that is furthest outside the bounds of its parameter; None if all are inside."""
    low = -np.inf if parameter.minimum is None else parameter.minimum
    high = np.inf if parameter.maximum is None else parameter.maximum
    if array is None or not array.size or not np.all(np.isfinite(array)):
        return None
    beyond = np.maximum(low - array, array - high)
    worst = np.unravel_index(np.argmax(beyond), beyond.shape)
    # a bound that single precision rounded may lie outside itself
    nearest = np.clip(array[worst], low, high)
    return float(array[worst]) if beyond[worst] > _ROUNDING * abs(nearest) else None

"""Writes learned parameters with their standard errors as JSON values."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from compiler.ir.program import Parameter, Program
from msnn.data.dataset import BoolArray, FloatArray
from msnn.training.records.learned.beside_bounds import is_near_bound
from msnn.training.records.learned.standard_errors import StandardErrors
from msnn.training.records.learned.zero_slices import zero_slices
from msnn.training.records.metrics_log import finite


def parameters_record(
    program: Program, weights: Mapping[str, FloatArray], found: StandardErrors | None
) -> dict[str, Any]:
    """Every parameter with unit, values and standard errors, and the basis of these errors.

    The standard error of an element is null if it was not trained in the last stage or is at a
    bound. It is also null for zeros set by a penalty and for unidentifiable elements.
    """
    errors: Mapping[str, FloatArray] = {} if found is None else found.errors
    record: dict[str, Any] = {
        "parameters": [
            {
                "name": parameter.name,
                "unit": parameter.unit and parameter.unit.text,
                "shape": [axis.size for axis in parameter.axes],
                "initial": finite(list(parameter.initial)),
                "values": finite(weights[parameter.name].ravel().tolist()),
                "learn": parameter.learn,
                "at_bound": parameter.learn and bool(at_bound(parameter, weights, found).any()),
                "standard_errors": finite(errors[parameter.name].ravel().tolist())
                if parameter.name in errors
                else None,
            }
            for parameter in program.parameters
        ]
    }
    zero = zero_slices(program, weights)
    if zero:
        record["zero_slices"] = zero
    if found is not None:
        record["standard_errors"] = {
            "residuals": found.residuals,
            "noise": dict(found.noise),
            "unidentified": [dict(change) for change in found.unidentified],
            "reason": found.reason,
        }
    return record


def at_bound(
    parameter: Parameter, weights: Mapping[str, FloatArray], found: StandardErrors | None
) -> BoolArray:
    """The elements at a bound, by the derivative if known, else by the distance."""
    known = None if found is None or found.beside is None else found.beside.held
    if known is not None and parameter.name in known:
        return known[parameter.name]
    return is_near_bound(parameter, weights[parameter.name])


def has_unidentified(record: Mapping[str, Any], found: Mapping[str, Any]) -> bool:
    """True if an element of a learned parameter has no standard error, apart from penalised zeros.

    `found` is the entry of the parameter in the record.
    """
    penalised = {each["array"] for each in record.get("zero_slices", ())}
    by_penalty = found["name"] in penalised
    errors = found["standard_errors"] or ()
    return any(
        error is None and not (by_penalty and value == 0.0)
        for value, error in zip(found["values"], errors, strict=False)
    )

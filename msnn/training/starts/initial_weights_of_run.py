"""Determines the initial weights of a training: initial values, statistics, fits (R12)."""

from __future__ import annotations

from compiler.ir.program import Program
from msnn.data.dataset import Dataset, FloatArray
from msnn.errors.learning import stages as errors
from msnn.model.weights.weights_file import initial_weights
from msnn.training.starts.fitted_arrays import fitted_arrays
from msnn.training.starts.statistics import with_statistics
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError


def first_weights(program: Program, data: Dataset) -> dict[str, FloatArray]:
    """The initial values, with statistics and fits from the training rows.

    Raises SpecError if the rows do not determine them.
    """
    weights = with_statistics(program, data, initial_weights(program))
    faults: list[Diagnostic] = []
    for fit in program.fits:
        found = fitted_arrays(fit, program, data, weights)
        if found is None:
            place = program.parameter(f"{fit.layer}.reflection").span
            faults.append(errors.no_fit(fit.layer, fit.target.signal, place))
            continue
        for array, values in found.items():
            name = f"{fit.layer}.{array}"
            weights[name] = values.reshape(weights[name].shape)
    if faults:
        raise SpecError(faults)
    return weights

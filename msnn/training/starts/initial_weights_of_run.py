"""Finds the weights that training begins with: initial values, statistics, fits (R12)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from compiler.ir.fit import Fit
from compiler.ir.program import Program
from msnn.data.dataset import Dataset, FloatArray
from msnn.errors import stages as errors
from msnn.model.weights_file import initial_weights
from msnn.training.plans.stage_data import TRAIN
from msnn.training.starts.filter_to_state_space import reflection_of, state_space_of
from msnn.training.starts.linear_fit import Piece, Structure, fitted_filter
from msnn.training.starts.statistics import with_statistics
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError


def first_weights(program: Program, data: Dataset) -> dict[str, FloatArray]:
    """The initial values, with what the rows of `train` say about statistics and filters.

    Raises SpecError where they do not say it.
    """
    weights = with_statistics(program, data, initial_weights(program))
    faults: list[Diagnostic] = []
    for fit in program.fits:
        found = _fitted(fit, data)
        if found is None:
            place = program.parameter(f"{fit.layer}.reflection").span
            faults.append(errors.no_fit(fit.layer, fit.input, fit.target.signal, place))
            continue
        for array, values in found.items():
            name = f"{fit.layer}.{array}"
            weights[name] = values.reshape(weights[name].shape)
    if faults:
        raise SpecError(faults)
    return weights


def _fitted(fit: Fit, data: Dataset) -> dict[str, FloatArray] | None:
    structure = Structure(0 if fit.feedthrough else 1, fit.num, fit.den, fit.radius)
    found = fitted_filter(list(_pieces(fit, data)), structure)
    if found is None:
        return None
    match fit.kind:
        case "iir":
            return {"num": found.numerator, "reflection": reflection_of(found.denominator)}
        case "state_space":
            arrays = state_space_of(found, fit.radius)
            return {name: arrays[name] for name in fit.arrays}


def _pieces(fit: Fit, data: Dataset) -> Iterator[Piece]:
    """Input and target of every run of rows of `train` in which both are known."""
    signal, target = data.series[fit.input], data.series[fit.target.signal]
    for start, stop in data.episodes(TRAIN):
        rows = slice(start, max(start, stop - fit.target.ahead))
        piece = Piece(signal[rows], target[start + fit.target.ahead : stop])
        known = np.isfinite(piece.input) & np.isfinite(piece.output)
        edges = np.flatnonzero(np.diff(known)) + 1
        for part in np.split(np.arange(len(known)), edges):
            if len(part) and known[part[0]]:
                yield Piece(piece.input[part], piece.output[part])

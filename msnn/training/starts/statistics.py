"""Sets the parameters that are statistics of the training data, before the first stage (R12)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from compiler.ir.program import Parameter, Program
from msnn.data.dataset import Dataset, FloatArray
from msnn.errors import training as errors
from msnn.training.plans.stage_data import TRAIN
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError


def with_statistics(
    program: Program, data: Dataset, weights: Mapping[str, FloatArray]
) -> dict[str, FloatArray]:
    """The weights with mean and standard deviation of the rows of `train`, missing ones left out.

    Raises SpecError where a signal has no rows, or is constant and cannot be divided by.
    """
    found = dict(weights)
    faults: list[Diagnostic] = []
    for parameter in program.parameters:
        if parameter.statistic is None:
            continue
        value = _statistic(parameter, data)
        if value is None:
            signal = parameter.statistic.signal
            faults.append(errors.no_statistic(parameter.name, signal, parameter.span))
        else:
            found[parameter.name] = value
    if faults:
        raise SpecError(faults)
    return found


def _statistic(parameter: Parameter, data: Dataset) -> FloatArray | None:
    assert parameter.statistic is not None
    rows = data.series[parameter.statistic.signal][data.in_set(TRAIN)]
    known = np.isfinite(rows)
    if not known.any(axis=0).all():
        return None
    mean = np.mean(rows, axis=0, where=known)
    if parameter.statistic.kind == "mean":
        return np.asarray(mean)
    std = np.asarray(np.std(rows, axis=0, where=known))
    # a sum of equal numbers rounds, so that their deviation need not be exactly 0
    return std if np.all(std > 1e-12 * np.abs(mean)) and np.all(std > 0) else None

"""Sets parameters that are statistics of the training data, before the first stage (R12)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from backends.files.disk_arrays import AT_ONCE, blocks
from compiler.ir.program import Parameter, Program
from msnn.data.dataset import BoolArray, Dataset, FloatArray
from msnn.errors.learning import training as errors
from msnn.training.plans.stage_data import TRAIN
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError


def with_statistics(
    program: Program, data: Dataset, weights: Mapping[str, FloatArray]
) -> dict[str, FloatArray]:
    """The weights with mean and standard deviation of the training rows, without missing values.

    Raises SpecError if a signal has no rows, or is constant and would be divided by 0.
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
    name = parameter.statistic.signal
    sums = [(np.sum(r, axis=0, where=k), np.sum(k, axis=0)) for r, k in _known(data, name)]
    count = sum((n for _, n in sums), np.zeros(()))
    if not np.all(count):
        return None
    mean = sum((total for total, _ in sums[1:]), sums[0][0]) / count
    if parameter.statistic.kind == "mean":
        return np.asarray(mean)
    # about the mean, in a second pass: sums of squares alone lose digits
    squares = [np.sum((r - mean) ** 2, axis=0, where=k) for r, k in _known(data, name)]
    std = np.asarray(np.sqrt(sum(squares[1:], squares[0]) / count))
    # a sum of equal numbers rounds, so that their deviation need not be exactly 0
    return std if np.all(std > 1e-12 * np.abs(mean)) and np.all(std > 0) else None


def _known(data: Dataset, name: str) -> Iterator[tuple[FloatArray, BoolArray]]:
    """Yields the training rows of a signal in blocks, with the mask of finite values.

    Sums over these blocks have the same bits for data in memory and on disk.
    """
    series, code = data.series[name], data.sets.index(TRAIN) if TRAIN in data.sets else None
    for begin, block in enumerate(blocks(series)):
        first = begin * AT_ONCE
        rows = block[data.set_of_row[first : first + len(block)] == code]
        if len(rows):
            yield rows, np.isfinite(rows)

"""Determines the initial weights of a training: initial values, statistics, fits, draws (R12)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np

from backends.files.disk_arrays import AT_ONCE, blocks
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.ops import ReadSignal
from compiler.ir.program import Fit, Graph, Output, Parameter, Program
from msnn.data.dataset import BoolArray, Dataset, FloatArray
from msnn.errors.learning import stages as stage_errors
from msnn.errors.learning import training as training_errors
from msnn.model.weights.weights_file import initial_weights
from msnn.training.plans.stage_data import TRAIN
from msnn.training.plans.stage_plan import StagePlan
from msnn.training.starts.lattice import lattice_of, reflections_of, stable
from msnn.training.starts.linear_fit import FilterStructure, UnbrokenRows, fitted_filter
from msnn.training.starts.state_space_fit import (
    RowsWithoutGap,
    StateSpaceArrays,
    driven_by_all,
    with_read,
)
from msnn.training.starts.subspace_fit import fitted_system
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError


def with_statistics(
    program: Program, data: Dataset, weights: Mapping[str, FloatArray]
) -> dict[str, FloatArray]:
    """Sets parameters that are a statistic of a signal: its mean or standard deviation in training
    rows.

    Missing values are ignored. Raises SpecError if a signal has no rows, or is constant and would
    be divided by 0.
    """
    found = dict(weights)
    faults: list[Diagnostic] = []
    for parameter in program.parameters:
        if parameter.statistic is None:
            continue
        value = _statistic(parameter, data)
        if value is None:
            signal = parameter.statistic.signal
            faults.append(training_errors.no_statistic(parameter.name, signal, parameter.span))
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


_AT_ONCE = 1 << 16
"""Number of rows for which the argument is computed together."""


def fitted_arrays(
    fit: Fit, program: Program, data: Dataset, weights: Mapping[str, FloatArray]
) -> dict[str, FloatArray] | None:
    """Initial values of an `iir` or `state_space` layer, fitted to the training rows by least
    squares.

    Returns the arrays by their local names; None if there are too few rows. Learned parameters in
    the argument of the layer have their initial values.
    """
    parts = list(_series(fit, program, data, weights))
    if not parts:
        return None
    match fit.kind:
        case "iir":
            return _filters(fit, parts)
        case "state_space":
            found = _system(fit, parts)
            if found is None:
                return None
            arrays = {"B": found.drive, "C": found.read, "D": found.direct}
            arrays["reflection"] = found.reflection
            return {name: arrays[name] for name in fit.array_names}


def _filters(fit: Fit, parts: list[RowsWithoutGap]) -> dict[str, FloatArray] | None:
    """Fits one filter per element of the argument."""
    structure = FilterStructure(0, fit.num, fit.den, fit.radius, is_direct=True)
    columns = range(parts[0].inputs.shape[1])
    found = [fitted_filter(_pieces(parts, column), structure) for column in columns]
    filters = [each for each in found if each is not None]
    if len(filters) < len(found):
        return None
    return {
        "num": np.stack([each.numerator for each in filters]),
        "reflection": np.stack([each.reflection for each in filters]),
    }


def _system(fit: Fit, parts: list[RowsWithoutGap]) -> StateSpaceArrays | None:
    inputs, outputs = parts[0].inputs.shape[1], parts[0].outputs.shape[1]
    radius, feedthrough = fit.radius, fit.feedthrough
    if inputs > 1 or outputs > 1:
        return fitted_system(parts, fit.den, radius=radius, feedthrough=feedthrough)
    # without feedthrough the first sample that counts is that of the step before
    structure = FilterStructure(0 if feedthrough else 1, fit.num, fit.den, radius)
    found = fitted_filter(_pieces(parts, 0), structure)
    if found is None:
        return None
    # A of the layer is radius · lattice: the lattice itself has its poles within the unit circle
    poles = np.linalg.eigvals(lattice_of(found.reflection).matrix) / radius
    reflection = reflections_of(stable(np.asarray(poles, complex), 1.0))
    drive = driven_by_all(reflection, 1)
    return with_read(parts, reflection, drive, radius=radius, feedthrough=feedthrough)


def _pieces(parts: list[RowsWithoutGap], column: int) -> list[UnbrokenRows]:
    return [UnbrokenRows(part.inputs[:, column], part.outputs[:, column]) for part in parts]


def _series(
    fit: Fit, program: Program, data: Dataset, weights: Mapping[str, FloatArray]
) -> Iterator[RowsWithoutGap]:
    """Yields the values of a layer's argument and of its target, for each interval of training
    rows.

    An interval ends where one of them is missing.
    """
    back, ahead = _reach(fit.argument)
    node = fit.argument.nodes[-1]
    output = Output(fit.layer, len(fit.argument) - 1)
    alone = Program(
        name=program.name,
        sample_time=program.sample_time,
        signals=program.signals,
        parameters=program.parameters,
        states=(),
        step=fit.argument,
        start=Graph(),
        outputs=(output,),
    )
    argument = Interpreter(alone, weights)
    signal = data.series[fit.target.signal]
    axes = [axis.name for axis in program.signal(fit.target.signal).axes]
    if fit.kind == "iir" and axes:  # each element of the argument follows one of the target
        order = [axes.index(axis.name) for axis in node.type.axes]
        signal = signal.transpose(0, *(1 + place for place in order))
    for start, stop in data.episodes(TRAIN):
        t = np.arange(start + back, stop - max(ahead, fit.target.ahead))
        if not len(t):
            continue
        inputs = np.concatenate(
            [
                argument.step(data.series, t[begin : begin + _AT_ONCE], {}).outputs[fit.layer]
                for begin in range(0, len(t), _AT_ONCE)
            ]
        ).reshape(len(t), -1)
        outputs = signal[t + fit.target.ahead].reshape(len(t), -1)
        known = np.all(np.isfinite(inputs), axis=1) & np.all(np.isfinite(outputs), axis=1)
        # across a missing value an equation would join samples that are not neighbours
        edges = np.flatnonzero(np.diff(known)) + 1
        for part in np.split(np.arange(len(t)), edges):
            if len(part) and known[part[0]]:
                rows = slice(part[0], part[-1] + 1)
                yield RowsWithoutGap(inputs[rows], outputs[rows])


def _reach(argument: Graph) -> tuple[int, int]:
    """How many samples before t and after t the argument reads."""
    reads = [node.op for _, node in argument if isinstance(node.op, ReadSignal)]
    return max([0, *(-read.first for read in reads)]), max([0, *(read.last for read in reads)])


def first_weights(program: Program, data: Dataset) -> dict[str, FloatArray]:
    """The weights with which training begins: initial values, statistics and fits of training rows.

    Raises SpecError if the rows do not determine them.
    """
    weights = with_statistics(program, data, initial_weights(program))
    faults: list[Diagnostic] = []
    for fit in program.fits:
        found = fitted_arrays(fit, program, data, weights)
        if found is None:
            place = program.parameter(f"{fit.layer}.reflection").span
            faults.append(stage_errors.no_fit(fit.layer, fit.target.signal, place))
            continue
        for array, values in found.items():
            name = f"{fit.layer}.{array}"
            weights[name] = values.reshape(weights[name].shape)
    if faults:
        raise SpecError(faults)
    return weights


Weights = Mapping[str, FloatArray]
Draws = Callable[[int], Weights]
"""Returns random initial values by number."""


def drawn_weights(
    program: Program, plan: StagePlan, weights: Weights, redrawn: Draws | None, attempt: int
) -> Weights:
    """The initial weights of an attempt: trained parameters at initial values are drawn again."""
    if attempt == 0 or redrawn is None:
        return weights
    initial, drawn = initial_weights(program), redrawn(attempt)
    return {
        name: drawn[name]
        if name in plan.trained and np.array_equal(value, initial[name])
        else value
        for name, value in weights.items()
    }


def begins_alike(
    program: Program, plan: StagePlan, weights: Weights, redrawn: Draws | None
) -> bool:
    """True if several attempts at a stage would all be identical, because nothing random is in
    them.
    """
    if plan.attempts == 1 or plan.masks:
        return False
    second = drawn_weights(program, plan, weights, redrawn, 1)
    return all(np.array_equal(second[name], weights[name]) for name in plan.trained)

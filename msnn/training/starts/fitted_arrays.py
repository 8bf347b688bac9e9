"""Fits the arrays of a layer with `fit:` to the training rows (R12)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from compiler.interpreter.interpreter import Interpreter
from compiler.ir.ops import ReadSignal
from compiler.ir.program import Fit, Graph, Output, Program
from msnn.data.dataset import Dataset, FloatArray
from msnn.training.plans.stage_data import TRAIN
from msnn.training.starts.filter_equations import FilterStructure, UnbrokenRows
from msnn.training.starts.lattice import lattice_of, reflections_of, stable
from msnn.training.starts.linear_fit import fitted_filter
from msnn.training.starts.state_space_fit import (
    RowsWithoutGap,
    StateSpaceArrays,
    driven_by_all,
    with_read,
)
from msnn.training.starts.subspace_fit import fitted_system

_AT_ONCE = 1 << 16
"""Number of rows for which the argument is computed together."""


def fitted_arrays(
    fit: Fit, program: Program, data: Dataset, weights: Mapping[str, FloatArray]
) -> dict[str, FloatArray] | None:
    """The arrays of the layer by their local names; None if there are too few rows.

    Learned parameters in the argument have their initial values.
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
    """One filter per element."""
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
    """Argument and target of every interval of training rows in which both are known."""
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
    """The number of samples before and after t that the argument reads."""
    reads = [node.op for _, node in argument if isinstance(node.op, ReadSignal)]
    return max([0, *(-read.first for read in reads)]), max([0, *(read.last for read in reads)])

"""Selects the contents of simulation plots: order of runs, and elements of vectors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from compiler.ir.program import Program, Signal
from compiler.ir.types import Axis
from msnn.data.dataset import FloatArray
from msnn.simulation.simulate import Simulation
from spec_schema.units.unit import Unit

MOST_CHANNELS = 8
"""Maximum number of elements of all outputs, or of all inputs, in a plot."""
MOST_ELEMENTS = 6
"""Maximum number of elements of one vector."""
_FIRST = ("test", "val", "train")


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnNumber:
    """One plotted element of an output or a signal: its name, source, unit and limits, no values.

    `of` extracts its values from those of the source.
    """

    name: str
    """`v`, or `q[1]` for a vector."""
    source: str
    """The output or signal that contains it."""
    index: tuple[int, ...]
    unit: str
    low: float | None
    high: float | None
    """Limits of its declared range."""
    predicts: tuple[str, int] | None = None
    """The predicted channel, and the number of samples ahead."""
    predicted_source: str = ""
    """The signal of that channel."""
    error_unit: str = ""
    """The unit of its errors: K for degC."""

    def of(self, values: FloatArray) -> FloatArray:
        """Its values, extracted from the (steps, *shape) of its source."""
        return np.asarray(values[(slice(None), *self.index)], np.float64)


def shown_first(runs: Sequence[Simulation]) -> list[Simulation]:
    """The simulations in the order in which plots show them: test set, validation, training."""

    def rank(run: Simulation) -> int:
        sets = set(run.places.sets)
        places = [place for place, name in enumerate(_FIRST) if name in sets]
        return min(places, default=len(_FIRST))

    # stable: within a set records keep the order of their files
    return sorted(runs, key=rank)


def element_name(name: str, index: tuple[int, ...]) -> str:
    """`q` or `q[1, 0]`."""
    return f"{name}[{', '.join(map(str, index))}]" if index else name


def channels(signals: Sequence[Signal]) -> list[DrawnNumber]:
    """The elements of signals, at most MOST_ELEMENTS per vector."""
    found: list[DrawnNumber] = []
    for signal in signals:
        low, high = signal.range or (None, None)
        for index in _indices(signal.axes):
            name = element_name(signal.name, index)
            unit = unit_of(signal.unit)
            found.append(
                DrawnNumber(
                    name=name,
                    source=signal.name,
                    index=index,
                    unit=unit,
                    low=low,
                    high=high,
                    error_unit=unit_of(signal.unit and signal.unit.difference),
                )
            )
    return found[:MOST_CHANNELS]


def output_channels(program: Program) -> list[DrawnNumber]:
    """The elements of outputs, predicting ones first."""
    found: list[DrawnNumber] = []
    # False sorts first
    for output in sorted(program.outputs, key=lambda output: output.predicts is None):
        type = program.step[output.node].type
        low, high = program.expected_range(output.name) or (None, None)
        unit, predicts = type.unit, output.predicts
        if predicts is not None:
            # a simulation drops the signals that it does not read
            for signal in (s for s in program.signals if s.name == predicts.signal):
                # a formula without units predicts a signal that has one
                unit = unit or signal.unit
                if low is None and high is None and signal.range is not None:
                    low, high = signal.range
        for index in _indices(type.axes):
            found.append(
                DrawnNumber(
                    name=element_name(output.name, index),
                    source=output.name,
                    index=index,
                    unit=unit_of(unit),
                    error_unit=unit_of(unit and unit.difference),
                    low=low,
                    high=high,
                    predicts=None
                    if predicts is None
                    else (element_name(predicts.signal, index), predicts.ahead),
                    predicted_source="" if predicts is None else predicts.signal,
                )
            )
    return found[:MOST_CHANNELS]


def _indices(axes: Sequence[Axis]) -> list[tuple[int, ...]]:
    # lazily: a field of a PDE has thousands of indices
    return list(islice(np.ndindex(*(axis.size for axis in axes)), MOST_ELEMENTS))


def unit_of(unit: Unit | None) -> str:
    """The text of a unit for the label of an axis; empty if the quantity is dimensionless."""
    return "" if unit is None or unit.text == "1" else unit.text


def with_unit(name: str, unit: str) -> str:
    """The label of an axis: the name and, if any, the unit."""
    return f"{name} / {unit}" if unit else name

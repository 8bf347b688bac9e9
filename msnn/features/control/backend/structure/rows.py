"""Lists the bounded rows of a problem in the order of the solver, and what is known of each.

Rows of controls come first, then those of rates, then bounded values: those that read a control of
their step (bounded at k = 0 … N−1), then the others (k = 1 … N). Row r has the sides 2 r (lowest)
and 2 r + 1 (highest).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from compiler.interpreter.interpreter import Interpreter
from compiler.ir.types import Type
from msnn.features.control.problem.optimal_control.problem import ControlProblem, Limits, PathLimits


@dataclass(frozen=True, slots=True)
class RatedControl:
    """A number of the controls that moves by at most so much from sample to sample."""

    control: int
    before: int
    """Where the state has its value of the sample before."""
    most: float


@dataclass(frozen=True, slots=True)
class Row:
    """One bounded number; `linear` and `quadratic` are what exceeding it costs, 0 if it cannot be.

    A violation v costs linear · v + quadratic · v² / 2.
    """

    name: str
    minimum: float | None
    maximum: float | None
    """None where there is none; any number where it moves."""
    scale: float
    linear: float = 0.0
    quadratic: float = 0.0
    hard: bool = False


@dataclass(frozen=True, slots=True)
class LimitOutput:
    """The output that limits rows which follow each other."""

    output: str
    first_side: int
    size: int


@dataclass(frozen=True, slots=True)
class Rows:
    """All rows of a problem."""

    rows: tuple[Row, ...]
    rates: tuple[RatedControl, ...]
    paths: tuple[PathLimits, ...]
    """In the order of their rows."""
    terminal: int
    """How many of the last rows are bounded at the end of the horizon."""
    outputs: tuple[LimitOutput, ...]
    move: bool
    """Whether limits follow references."""


FIRST_WEIGHT = 100.0
"""Cost of exceeding a hard bound by its scale, before it grows; in units of the stage cost."""


def rows_of(problem: ControlProblem) -> Rows:
    """The rows of a trained problem."""
    known = _Limits(problem)
    rows: list[Row] = []
    rates: list[RatedControl] = []
    for member, control in zip(problem.controls.members, problem.control_limits, strict=True):
        low, high = known.of(control.limits, len(rows), member.size)
        rows += [Row(control.name, low[i], high[i], control.scale) for i in range(member.size)]
        if control.rate is not None:
            places = problem.previous(control.name)
            # a control with a rate has its last value in the state: the problem adds that where it
            # is missing
            assert places is not None
            rates += [
                RatedControl(member.first + i, place, control.rate)
                for i, place in enumerate(places)
            ]
    rows += [
        Row(f"rate of {rows[rate.control].name}", -rate.most, rate.most, rate.most)
        for rate in rates
    ]
    # `sorted` is stable: within both kinds the order of the spec stays
    paths = tuple(sorted(problem.path_limits, key=lambda path: not path.reads_control))
    terminal = 0
    for path in paths:
        size = problem.type(path.value).size
        low, high = known.of(path.limits, len(rows), size)
        linear = path.linear if path.linear is not None else FIRST_WEIGHT / path.scale
        # the spec's cost is quadratic · v², a row's is half of that
        quadratic = 2 * path.quadratic if path.quadratic is not None else linear / path.scale
        rows += [
            Row(path.name, low[i], high[i], path.scale, linear, quadratic, path.hard)
            for i in range(size)
        ]
        terminal += 0 if path.reads_control else size
    return Rows(tuple(rows), tuple(rates), paths, terminal, tuple(known.outputs), known.move)


def resting_controls(rows: Rows, count: int) -> list[float]:
    """The controls before anything is known: 0, or the limit that is nearest to it."""
    # limits that move are placeholders here
    return [0.0 if rows.move else _nearest_to_zero(row) for row in rows.rows[:count]]


def _nearest_to_zero(row: Row) -> float:
    value = 0.0 if row.minimum is None else max(row.minimum, 0.0)
    return value if row.maximum is None else min(value, row.maximum)


class _Limits:
    """Limits as numbers, where they are known."""

    def __init__(self, problem: ControlProblem) -> None:
        self._problem = problem
        self.outputs: list[LimitOutput] = []
        self.move = False

    def of(
        self, limits: Limits, first_row: int, size: int
    ) -> tuple[list[float | None], list[float | None]]:
        """The lowest and the highest value of each of these rows."""
        return (
            self._side(limits.minimum, 2 * first_row, size),
            self._side(limits.maximum, 2 * first_row + 1, size),
        )

    def _side(self, output: str | None, first_side: int, size: int) -> list[float | None]:
        if output is None:
            return [None] * size
        problem = self._problem
        self.outputs.append(LimitOutput(output, first_side, size))
        node = problem.node(output)
        if problem.reads(node).signals:
            self.move = True
            # any number: the controller evaluates them before each solve
            return [0.0] * size
        values = _constant(problem, output)
        return [float(value) for value in np.broadcast_to(values, (size,))]


def _constant(problem: ControlProblem, output: str) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """The value of an output that reads nothing."""
    log = {
        signal.name: np.zeros((_samples(problem), *Type(signal.axes).shape))
        for signal in problem.program.signals
    }
    states = {
        state.name: np.zeros((1, *Type(state.axes).shape)) for state in problem.program.states
    }
    found = Interpreter(problem.program).step(log, np.arange(1), states, losses=False)
    return np.asarray(found.outputs[output], np.float64).reshape(1, -1)[0]


def _samples(problem: ControlProblem) -> int:
    windows = (Type(member.axes).window or 1 for member in problem.disturbances.members)
    return 1 + max(windows, default=1)

"""Lists the scalar inequality constraints (rows) of one stage in the order of the solver.

Rows of controls come first, then limits of rates, then path limits: those that read a control of
their step (k = 0 … N−1), then the others (k = 1 … N). Row r has two sides: index 2 r is its
minimum, 2 r + 1 its maximum.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from compiler.interpreter.interpreter import Interpreter
from compiler.ir.types import Type
from msnn.features.control.problem.optimal_control import ControlProblem, Limits, PathLimits


@dataclass(frozen=True, slots=True)
class RatedControl:
    """A scalar control with a rate limit: |u_k − u_{k−1}| ≤ most."""

    control: int
    """Its index in u."""
    before: int
    """The index in x of its previous value."""
    most: float
    """In the unit of the control, per sample."""


@dataclass(frozen=True, slots=True)
class Row:
    """One scalar of a stage with a minimum, a maximum or both.

    A violation v costs linear · v + quadratic · v² / 2. Limits of controls and rates are never
    violated; their costs are 0. `scale` is the typical size of the scalar.
    """

    name: str
    minimum: float | None
    maximum: float | None
    """None if there is no limit; a placeholder if the limit depends on references."""
    scale: float
    linear: float = 0.0
    quadratic: float = 0.0
    hard: bool = False


@dataclass(frozen=True, slots=True)
class LimitOutput:
    """An output of the program that computes one side of the limits of consecutive rows."""

    output: str
    first_side: int
    """The index of the first row's side; the next row's is 2 further."""
    size: int
    """Number of rows."""


@dataclass(frozen=True, slots=True)
class Rows:
    """The rows of one stage of a problem."""

    rows: tuple[Row, ...]
    rates: tuple[RatedControl, ...]
    paths: tuple[PathLimits, ...]
    """Path limits, in the order of their rows."""
    terminal: int
    """Number of rows, the last ones, that also hold at the end of the horizon, k = N."""
    outputs: tuple[LimitOutput, ...]
    move: bool
    """True if any limit depends on references, so that the controller evaluates all at run time."""


FIRST_WEIGHT = 100.0
"""Cost of violating a path limit without a weight by its scale, in units of the stage cost.

The solver multiplies the weights of hard limits until they hold.
"""


def rows_of(problem: ControlProblem) -> Rows:
    """Lists the rows of a problem without parameters. Limits that depend on references become
    placeholders.
    """
    limits = _Limits(problem)
    rows: list[Row] = []
    rates: list[RatedControl] = []
    for member, control in zip(problem.controls.members, problem.control_limits, strict=True):
        low, high = limits.of(control.limits, len(rows), member.size)
        rows += [Row(control.name, low[i], high[i], control.scale) for i in range(member.size)]
        if control.rate is not None:
            places = problem.previous(control.name)
            # the problem adds the previous value of a control with a rate to x
            assert places is not None
            rates += [
                RatedControl(member.first + i, place, control.rate)
                for i, place in enumerate(places)
            ]
    rows += [
        Row(f"rate of {rows[rate.control].name}", -rate.most, rate.most, rate.most)
        for rate in rates
    ]
    # `sorted` is stable: both kinds keep the order of the spec
    paths = tuple(sorted(problem.path_limits, key=lambda path: not path.reads_control))
    terminal = 0
    for path in paths:
        size = problem.type(path.value).size
        low, high = limits.of(path.limits, len(rows), size)
        linear = path.linear if path.linear is not None else FIRST_WEIGHT / path.scale
        # the spec's cost is quadratic · v², a row's is half of that
        quadratic = 2 * path.quadratic if path.quadratic is not None else linear / path.scale
        rows += [
            Row(path.name, low[i], high[i], path.scale, linear, quadratic, path.hard)
            for i in range(size)
        ]
        terminal += 0 if path.reads_control else size
    return Rows(tuple(rows), tuple(rates), paths, terminal, tuple(limits.outputs), limits.move)


def resting_controls(rows: Rows, count: int) -> list[float]:
    """Returns the `count` controls that a new controller assumes: 0, or the limit nearest to 0."""
    # limits that depend on references are placeholders here
    return [0.0 if rows.move else _nearest_to_zero(row) for row in rows.rows[:count]]


def _nearest_to_zero(row: Row) -> float:
    """Returns 0, limited to the range of the row."""
    value = 0.0 if row.minimum is None else max(row.minimum, 0.0)
    return value if row.maximum is None else min(value, row.maximum)


class _Limits:
    """Evaluates limits that are constant, and collects the outputs that compute limits."""

    def __init__(self, problem: ControlProblem) -> None:
        self._problem = problem
        self.outputs: list[LimitOutput] = []
        self.move = False

    def of(
        self, limits: Limits, first_row: int, size: int
    ) -> tuple[list[float | None], list[float | None]]:
        """Returns minimum and maximum of `size` rows from `first_row` on; None without a limit."""
        return (
            self._side(limits.minimum, 2 * first_row, size),
            self._side(limits.maximum, 2 * first_row + 1, size),
        )

    def _side(self, output: str | None, first_side: int, size: int) -> list[float | None]:
        """Returns one side of `size` rows, whose limits the program's `output` computes, if any."""
        if output is None:
            return [None] * size
        problem = self._problem
        self.outputs.append(LimitOutput(output, first_side, size))
        node = problem.node(output)
        if problem.reads(node).signals:
            self.move = True
            # placeholders: the controller evaluates limits before each solve
            return [0.0] * size
        values = _constant(problem, output)
        return [float(value) for value in np.broadcast_to(values, (size,))]


def _constant(problem: ControlProblem, output: str) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Returns the value of a constant output, flattened, from the interpreter."""
    log = {
        signal.name: np.zeros((_samples(problem), *Type(signal.axes).shape))
        for signal in problem.program.signals
    }
    states = {
        state.name: np.zeros((1, *Type(state.axes).shape)) for state in problem.program.states
    }
    step = Interpreter(problem.program).step(log, np.arange(1), states, losses=False)
    return np.asarray(step.outputs[output], np.float64).reshape(1, -1)[0]


def _samples(problem: ControlProblem) -> int:
    """Returns the rows of a log that the windows of disturbances need for one step."""
    windows = (Type(member.axes).window or 1 for member in problem.disturbances.members)
    return 1 + max(windows, default=1)

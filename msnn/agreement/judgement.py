"""Defines a comparison's inputs, the values of the reference interpreter, and a loaded export."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import field, replace
from enum import Enum
from pathlib import Path
from typing import Any, Literal, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from compiler.ir.program import Program, Signal
from compiler.jacobian.matrices import Jacobian
from msnn.data.dataset import FloatArray
from msnn.data.rollout_rows import reach
from msnn.errors.failures import MissingPluginError
from msnn.model.model import Model
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.late_dataclass import dataclass
from spec_schema.registry import FixedPoint

Arrays: TypeAlias = Mapping[str, NDArray[Any]]

FloatType: TypeAlias = Literal["float32", "float64"]
NumberType: TypeAlias = FloatType | FixedPoint
"""The number format of an export's computations."""


class Promise(Enum):
    """The accuracy that an export promises relative to the reference."""

    BITS = "the bits of the interpreter in the same arithmetic"
    ROUNDING = "each step as near to the interpreter in float64 as rounding allows"


@dataclass(frozen=True, slots=True)
class Beginning:
    """The known values at the first step of a simulation: samples around it, and initial states."""

    windows: Arrays
    """Samples for the initial states: one window per signal, (*shape)."""
    window_firsts: Mapping[str, int]
    """Index of the first sample in each window, relative to the first step."""
    states: Arrays
    """Initial states as the reference computes them, (*shape); some targets cannot compute all."""

    def window(self, signal: str, first: int, length: int) -> NDArray[Any]:
        """`length` samples of a signal from `first` on, (…, length); backends may need fewer
        samples.
        """
        # a backend may need fewer of the past than the judge's window has
        begin = first - self.window_firsts[signal]
        return self.windows[signal][..., begin : begin + length]


@dataclass(frozen=True, slots=True)
class Proof:
    """The steps of a fixed-point reference, the same steps in real arithmetic, and a proven error
    bound.

    The steps in real arithmetic use inputs and states of the reference. Keys are names in messages;
    arrays are (steps, *shape), initial states (1, *shape).
    """

    values: Arrays
    exact: Arrays
    bounds: Mapping[str, float]
    """Proven error bounds; inf if nothing is proven."""
    steps: Mapping[str, int]
    """Number of steps from the recorded inputs; further steps follow them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Judgement:
    """The values of the reference for all steps, (steps, *shape) by names of the spec.

    `states` are those before each step. A fixed-point reference has none, because exports cannot
    set them.
    """

    beginning: Beginning
    inputs: Arrays
    states: Arrays
    outputs: Arrays
    next_states: Arrays
    restarted: Mapping[str, NDArray[Any]] = field(default_factory=dict[str, NDArray[Any]])
    """Masks (steps,) of steps after which a state was reset."""
    proof: Proof | None = None
    """Proven error bounds of the reference itself, for fixed point."""

    @property
    def steps(self) -> int:
        """The number of steps."""
        return len(next(iter(self.outputs.values())))


Judge: TypeAlias = Callable[[NumberType], Judgement]
"""Simulates the recorded inputs in a number format."""

V = TypeVar("V")


def labelled(outputs: Mapping[str, V], next_states: Mapping[str, V]) -> dict[str, V]:
    """Outputs and next states by the names that messages use for them."""
    named = {f"`{name}`": values for name, values in outputs.items()}
    return named | {f"the state `{name}`": values for name, values in next_states.items()}


def labelled_first(states: Mapping[str, V]) -> dict[str, V]:
    """Initial states by the names that messages use for them."""
    return {f"the first state `{name}`": values for name, values in states.items()}


MOST_STEPS = 2000
"""Maximum number of compared steps."""
_DRAWN_STEPS = 500


@dataclass(frozen=True, slots=True)
class AgreementRecord:
    """The inputs of a comparison: series of all signals, (rows, *shape), and the steps t0 …
    t0+steps−1.
    """

    log: Mapping[str, FloatArray]
    t0: int
    steps: int
    origin: str
    """Description of the series' origin."""


def agreement_record(model: Model, program: Program, folder: Path) -> AgreementRecord:
    """The longest interval of the spec's data; random samples if no data can be read.

    `program` is the exported program in step form; the interval must contain one of its steps.
    """
    from msnn.data.reading.load import load_data

    # predictions are not compared with data here: their target rows may be missing
    program = _unscored(program)
    if model.spec.data is not None:
        try:
            data = load_data(program, model.spec.data, folder, recorded=model.recorded)
        except (SpecError, MissingPluginError):
            return drawn_record(program, "drawn numbers, as the spec's data cannot be read")
        # longest of those without gap: a free run goes through all of it
        stretches = data.stretches()
        if len(stretches):
            start, stop = stretches[int(np.argmax(stretches[:, 1] - stretches[:, 0]))].tolist()
            log = {name: series[start:stop] for name, series in data.series.items()}
            file = next(r.file for r in data.records if r.start <= start < r.stop)
            found = _record(program, log, stop - start, f"the data in {file}")
            if found.steps > 0:
                return found
    return drawn_record(program, "drawn numbers")


def drawn_record(program: Program, origin: str) -> AgreementRecord:
    """Random samples within the signals' ranges, or [-1, 1], always the same ones (Philox)."""
    random = np.random.Generator(np.random.Philox(0))
    far = reach(program)
    rows = far.rows(_DRAWN_STEPS)
    log = {
        signal.name: random.uniform(*_limits(signal), (rows, *(axis.size for axis in signal.axes)))
        for signal in program.signals
    }
    return _record(program, log, rows, origin)


def _unscored(program: Program) -> Program:
    """The program without `predicts`, so that target rows may be missing."""
    return replace(program, outputs=tuple(replace(o, predicts=None) for o in program.outputs))


def _record(
    program: Program, log: Mapping[str, FloatArray], rows: int, origin: str
) -> AgreementRecord:
    far = reach(_unscored(program))
    # steps need what ports read ahead, and no rows beyond the last
    steps = min(rows - far.back - far.ahead, rows - far.back)
    # the states before the first step may read the log ahead (R7)
    if rows - far.back <= far.start_ahead:
        steps = 0
    return AgreementRecord(log, far.back, max(min(steps, MOST_STEPS), 0), origin)


def _limits(signal: Signal) -> tuple[float, float]:
    low, high = signal.range or (-1.0, 1.0)
    if not math.isfinite(low):
        # half-open ranges are made as wide as the default one
        low = high - 2.0 if math.isfinite(high) else -1.0
    return low, high if math.isfinite(high) else low + 2.0


Start: TypeAlias = Callable[[Beginning], Arrays]
"""Computes the initial states, (1, *shape) each."""
Run: TypeAlias = Callable[[Beginning, Arrays, int], Arrays]
"""Simulates inputs (steps, *shape) from a beginning; returns outputs (steps, *shape)."""
Step: TypeAlias = Callable[[Arrays, Arrays, int], tuple[Arrays, Arrays]]
"""Executes independent single steps: inputs and states to outputs and next states, (steps,
*shape).
"""


@dataclass(frozen=True, slots=True)
class ExportedSlopes:
    """The Jacobian that an export computes: the structure of its matrices, and their values."""

    jacobian: Jacobian
    at: Callable[[Arrays, Arrays, int], Arrays]
    """Matrices (steps, rows, columns) by name, for inputs and states (steps, *shape)."""


def no_slopes() -> ExportedSlopes | None:
    """Returns None, for an export that has no Jacobian or a very large one."""
    return None


@dataclass(frozen=True, slots=True)
class Loaded:
    """An export that was loaded from its files, as functions that start, step and simulate it."""

    run: Run
    start: Start | None = None
    """None if states are not visible."""
    step: Step | None = None
    """None if states cannot be set; such a target can only promise identical bits."""
    slopes: Callable[[], ExportedSlopes | None] = no_slopes
    """Called only if Jacobians are compared, because they take longer than a step."""


def loaded_by_steps(
    start: Start, step: Step, slopes: Callable[[], ExportedSlopes | None] = no_slopes
) -> Loaded:
    """An export with explicit states, made from its functions for the start and for single steps.

    A simulation calls `step` for each sample.
    """

    def run(beginning: Beginning, inputs: Arrays, steps: int) -> Arrays:
        states = start(beginning)
        found: list[Arrays] = []
        for k in range(steps):
            given = {name: values[k : k + 1] for name, values in inputs.items()}
            outputs, states = step(given, states, 1)
            found.append(outputs)
        return {name: np.concatenate([one[name] for one in found]) for name in found[0]}

    return Loaded(run, start, step, slopes)


def stacked(steps: list[Arrays]) -> Arrays:
    """Stacks arrays of single steps to arrays (steps, *shape)."""
    return {name: np.stack([step[name] for step in steps]) for name in steps[0]}

"""Makes golden vectors: drawn starts, states and inputs, and the interpreter's results for them.

`selftest_text` chooses the runs that they begin with.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.c.interface.interface import Field, Interface
from backends.c.interface.status import StateCheck, StatusBit
from backends.c.selftest.drawn_inputs import (
    DrawnRecord,
    Outside,
    StartPoint,
    drawn_record,
    drawn_series,
    drawn_starts,
    knots_of,
    outside,
)
from backends.c.selftest.reference_step import (
    apply_policy,
    apply_policy_to_window,
    emptied,
    equation_bits,
    filled_by_first,
    first_held,
    first_state_bits,
    invalid_samples,
    log_of_steps,
    next_state_bits,
    restarted,
    saturation_bits,
    with_checked,
)
from backends.c_lowering.fuzzy_sets import sums_of_active_sets
from backends.c_lowering.state_memory import PlainState
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.program import Output, Program
from compiler.jacobian.jacobian import JacobianInterpreter

Array = NDArray[Any]


@dataclass(frozen=True, slots=True)
class GoldenStart:
    """Arguments and expected results of one `reset`, by name in the spec, in the type of C."""

    windows: dict[str, Array]
    """Raw samples that `reset` takes."""
    supplied: dict[str, Array]
    """States that `reset` takes as arguments."""
    states: dict[str, Array]
    """Expected states after `reset`, (1, *shape)."""
    status: StatusBit
    """The status that `reset` returns."""


def golden_start(
    interface: Interface, interpreter: Interpreter, record: DrawnRecord
) -> GoldenStart:
    """The arguments of `reset` for the samples in `record`, and the states and status that the
    reference interpreter expects from it.
    """
    windows: dict[str, Array] = {}
    log, bits = dict(record.log), StatusBit(0)
    for field, port in interface.windows:
        series = log[field.name].copy()
        rows = slice(record.t0 + port.first, record.t0 + port.last + 1)
        windows[field.name] = np.moveaxis(series[rows], 0, -1).reshape(field.shape).copy()
        checked = apply_policy_to_window(port.signal, series[rows], interface.options.dtype)
        # states are computed from the samples after the policy was applied
        series[rows], bits = checked[0], bits | checked[1]
        log[field.name] = series
    states = interpreter.start(log, record.t0)
    return GoldenStart(
        windows=windows,
        supplied={state.name: states[state.name][0] for _, state in interface.supplied},
        states=states,
        status=bits | first_state_bits(interface, states),
    )


def golden_starts(
    program: Program, interface: Interface, weights: Mapping[str, Array], seed: int
) -> list[GoldenStart]:
    """Starts that test the range checks of `reset` by the status it returns, one check each.
    `weights` are physical arrays by name; `seed` is that of the random samples.
    """
    options = interface.options
    random = np.random.Generator(np.random.Philox(seed))
    interpreter = Interpreter(program, weights, options.dtype)
    records = drawn_starts(program, random, options.dtype, options.unroll)
    return [golden_start(interface, interpreter, record) for record in records]


@dataclass(frozen=True, slots=True)
class WrittenNumber:
    """A value that a golden run writes into one element (index in C order) of a state before the
    first step.
    """

    state: str
    element: int
    value: float

    def into(self, states: Mapping[str, Array]) -> dict[str, Array]:
        """A copy of the states (1, *shape) by name in which the element has this value."""
        changed = states[self.state].copy()
        changed.reshape(-1)[self.element] = self.value
        return {**states, self.state: changed}


def written_states(interface: Interface) -> list[WrittenNumber]:
    """Values to write into states before a step, each of which should trigger one check of the
    states. They are needed where a start cannot reach a limit: a state with a constant start may
    need many steps, and one without a range is infinite only after an error.
    """
    return [written for check in interface.checks for written in _of(check, interface)]


def state_fields(interface: Interface) -> list[Field]:
    """The fields of the state struct with plain states, which have the shape of the spec; buffers
    are left out.
    """
    return [
        Field(
            name=memory.state.name,
            identifier=memory.identifier,
            axes=memory.state.axes,
            unit=memory.state.unit,
            comment="",
        )
        for memory in interface.states
        if isinstance(memory, PlainState)
    ]


def _of(check: StateCheck, interface: Interface) -> Iterator[WrittenNumber]:
    if not isinstance(check.memory, PlainState):
        return
    size = math.prod(check.memory.shape)
    # above `unroll` a loop looks at them: its first and last turn show where it begins and ends
    elements = range(size) if size <= interface.options.unroll else (0, size - 1)
    sides = _sides(check)
    for number, element in enumerate(elements):
        # elements share one check: each way to be outside once, in turn, shows it, and that each is
        # looked at; what is unrolled may look at NaN in one of them and not in another
        chosen = sides if size == 1 else [sides[number % len(sides)]] if sides else []
        for value in (*chosen, math.nan):
            yield WrittenNumber(check.memory.state.name, element, value)


def _sides(check: StateCheck) -> list[float]:
    """Values outside the limits of a check: one just above and one far below, if finite. For a
    check that a state is finite, only ∞.
    """
    if check.bit == StatusBit.STATE_NOT_FINITE:
        return [math.inf]
    found = [outside(check.limits, end) for end in ("above", "far below")]
    return [value for value in found if math.isfinite(value)]


_ANYWHERE = StartPoint()
_OF_ACTIVE_SETS = "active {}"
"""Names of sums that are added to the outputs; no name of a spec contains a space."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GoldenVectors:
    """One golden run: its data and expected results by name in the spec, in the type of the
    generated code. Series are (steps, *shape).
    """

    start: GoldenStart
    """The start before the first step."""
    written: dict[str, Array]
    """States that a harness writes into the struct after that; empty if it writes none."""
    inputs: dict[str, Array]
    """The inputs passed to the step, including invalid ones."""
    seen: dict[str, Array]
    """The inputs after the policies replaced invalid values."""
    outputs: dict[str, Array]
    states: dict[str, Array]
    """The states after each step."""
    status: NDArray[np.uint32]
    slopes: dict[str, Array]
    """Matrices of the Jacobian before each step, (steps, rows, columns); empty without one."""
    promised: bool = True
    """False if C omits an infinite or NaN term, so that the interpreter computes NaN and C does not
    (decision 0066)."""


@dataclass(frozen=True, slots=True)
class GoldenRun:
    """The choices from which a golden run is drawn: random seed, start, and invalid or written
    values.
    """

    seed: int
    start: StartPoint | Outside | None = _ANYWHERE
    """Part of their ranges, or outside, from which states start; None for a run without a past, as
    after `init`."""
    opening: int = 0
    """Number of invalid first samples of each input."""
    invalid: int | None = None
    """First kind of the invalid samples in the past (`drawn_record`); None if all are valid."""
    written: WrittenNumber | None = None
    """The value written into the state struct before the first step."""


def golden_runs(
    program: Program,
    interface: Interface,
    weights: Mapping[str, Array],
    steps: int,
    runs: Sequence[GoldenRun],
) -> list[GoldenVectors]:
    """Draws and computes `steps` steps of each of these runs, with weights (physical arrays by
    name). All runs are computed as one batch. The random generator is counter-based (Philox), so a
    seed gives the same values on every machine.
    """
    dtype = interface.options.dtype
    knots = knots_of(program, dtype)
    # in the arithmetic of the C: in float32 its answers are the bits that are promised
    skipping = sums_of_active_sets(program, interface.states)
    shown = [Output(_OF_ACTIVE_SETS.format(number), node) for number, node in enumerate(skipping)]
    judged = with_checked(program)
    judged = replace(judged, outputs=(*judged.outputs, *shown))
    interpreter = Interpreter(judged, weights, dtype)
    linearized = interface.jacobian and JacobianInterpreter(
        interface.jacobian.jacobian, program, weights, dtype
    )
    inputs: list[dict[str, Array]] = []
    begun: list[GoldenStart] = []
    for run in runs:
        random = np.random.Generator(np.random.Philox(run.seed))
        record = drawn_record(program, random, run.start or _ANYWHERE, dtype, invalid=run.invalid)
        inputs.append(
            {
                input.field.name: drawn_series(
                    input, steps, random, knots, run.opening, turn=number
                )
                for number, input in enumerate(interface.inputs)
            }
        )
        begun.append(golden_start(interface, interpreter, record))
    first = [_first_states(interface, run, start) for run, start in zip(runs, begun, strict=True)]
    seen, policy_bits = _seen(interface, inputs, steps)
    from_init = [k for k, run in enumerate(runs) if run.start is None and interface.from_record]
    states = {s.name: np.concatenate([each[s.name] for each in first]) for s in program.states}
    outputs = {f.name: np.empty((len(runs), steps, *f.shape), dtype) for f in interface.outputs}
    status = np.zeros((len(runs), steps), np.uint32)
    promised = np.ones(len(runs), np.bool_)
    slopes: list[dict[str, Array]] = []
    following: list[Mapping[str, Array]] = []

    def bits_of(answers: Mapping[str, Array], next: Mapping[str, Array]) -> StatusBit:
        """The status bits of equations and states out of range in at least one of the runs.
        `answers` are the outputs, `next` the next states.
        """
        bits = equation_bits(program, answers, dtype) | saturation_bits(program, answers)
        return bits | next_state_bits(interface, next)

    for k in range(steps):
        log = log_of_steps(interface, {n: values[:, k] for n, values in seen.items()}, len(runs))
        if linearized is not None:
            slopes.append(linearized.matrices(*log, states))
        # without a record buffers are empty: the first sample fills them, as in C
        if k == 0 and from_init:
            states = filled_by_first(interpreter, interface, states, log, from_init)
        result = interpreter.step(*log, states, losses=False)
        for name, values in outputs.items():
            values[:, k] = result.outputs[name]
        for sum in shown:
            values = result.outputs[sum.name]
            promised &= np.isfinite(values).reshape(len(values), -1).all(axis=1)
        # bits are told of the states that were computed; those that start again replace them
        # afterwards
        after = {name: value.copy() for name, value in result.next_states.items()}
        # hardly any step of any run leaves a range: each is looked at where one of them does
        somewhere = bits_of(result.outputs, result.next_states)
        for row in range(len(runs)):
            # a slice keeps the axis of the batch, which the references expect
            one = slice(row, row + 1)
            next = {name: value[one] for name, value in result.next_states.items()}
            bits = policy_bits[row][k]
            if somewhere:
                answers = {name: value[one] for name, value in result.outputs.items()}
                bits |= bits_of(answers, next)
            if row in from_init:
                # the first sample fills buffers; what needs a record waits until `reset`
                waits = interface.from_record - (interface.filled_by_first if k > 0 else set())
                bits |= StatusBit.UNINITIALISED if waits else StatusBit(0)
            status[row, k] = bits
            again = {s.name: begun[row].states[s.name] for s in program.states}
            again = {s.name: again[s.name] for s in program.states if s.on_range == "reset"}
            for name, value in restarted(interface, next, again).items():
                after[name][one] = value
        states = after
        following.append(after)
    names = slopes[0] if slopes else ()
    matrices = {name: np.stack([step[name] for step in slopes], axis=1) for name in names}
    remembered = {
        s.name: np.stack([step[s.name] for step in following], axis=1) for s in program.states
    }
    return [
        GoldenVectors(
            start=begun[row],
            written=_written(interface, run, first[row]),
            inputs=inputs[row],
            seen={name: values[row] for name, values in seen.items()},
            outputs={name: values[row] for name, values in outputs.items()},
            states={name: values[row] for name, values in remembered.items()},
            status=status[row],
            slopes={name: values[row] for name, values in matrices.items()},
            promised=bool(promised[row]),
        )
        for row, run in enumerate(runs)
    ]


def _first_states(interface: Interface, run: GoldenRun, begin: GoldenStart) -> dict[str, Array]:
    """The states (1, *shape) by name before the first step of a run: those after `reset` with the
    written value, or those after `init`, where states that need a recording are 0.
    """
    if run.start is None and interface.from_record:
        return emptied(interface, begin.states)
    return run.written.into(begin.states) if run.written else begin.states


def _written(interface: Interface, run: GoldenRun, first: Mapping[str, Array]) -> dict[str, Array]:
    fields = state_fields(interface) if run.written else ()
    return {field.name: first[field.name][0] for field in fields}


def _seen(
    interface: Interface, inputs: Sequence[Mapping[str, Array]], steps: int
) -> tuple[dict[str, Array], list[list[StatusBit]]]:
    """The inputs (runs, steps, *shape) by name after the policies, and the status bits of each run
    and step. `inputs` has, for each run, the raw inputs (steps, *shape).
    """
    dtype = interface.options.dtype
    bits = [[StatusBit(0)] * steps for _ in inputs]
    seen: dict[str, Array] = {}
    for input in interface.inputs:
        name, signal = input.field.name, input.port.signal
        given = np.stack([run[name] for run in inputs])
        accepted = given.copy()
        start = first_held(signal, input.field.shape, dtype)
        # in order: `hold` falls back to what it accepted before
        for row, k in np.argwhere(invalid_samples(signal, given, dtype)).tolist():
            before = accepted[row, k - 1] if k else start
            accepted[row, k], said = apply_policy(signal, given[row, k], before, dtype)
            bits[row][k] |= said
        seen[name] = accepted
    return seen, bits


def joined(runs: Sequence[GoldenVectors]) -> GoldenVectors:
    """One series with the steps of all runs one after the other; start and written states are those
    of the first run.
    """
    return replace(
        runs[0],
        inputs=_one_after_the_other([run.inputs for run in runs]),
        seen=_one_after_the_other([run.seen for run in runs]),
        outputs=_one_after_the_other([run.outputs for run in runs]),
        states=_one_after_the_other([run.states for run in runs]),
        status=np.concatenate([run.status for run in runs]),
        slopes=_one_after_the_other([run.slopes for run in runs]),
    )


def _one_after_the_other(series: Sequence[Mapping[str, Array]]) -> dict[str, Array]:
    return {name: np.concatenate([each[name] for each in series]) for name in series[0]}

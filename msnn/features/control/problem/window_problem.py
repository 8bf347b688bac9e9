"""Bounds the estimates: parameters by `min` and `max`, states by their declared ranges.

Bounds of parameters are hard: a window whose start and noise are 0 keeps them. A range of a state
can be left by what the model itself does, so that it is soft by an exact penalty.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from compiler.hessian.step_derivatives import next_value
from compiler.ir.builder import GraphBuilder, copy_node, with_step
from compiler.ir.ops import ReadSignal, Relation
from compiler.ir.program import (
    Declared,
    History,
    NodeId,
    Output,
    Program,
    Role,
    Signal,
    State,
    Tape,
)
from compiler.ir.types import WINDOW, Axis, Type
from compiler.jacobian.matrices import Vector, vector_of
from msnn.features.control.problem.optimal_control import (
    ControlLimits,
    ControlProblem,
    Limits,
    PathLimits,
)
from msnn.features.control.problem.state_estimation import (
    EstimatedNumbers,
    EstimationProblem,
    MovingWindow,
    augmented,
)


def with_limits(
    problem: EstimationProblem, program: Program, scales: Mapping[str, float]
) -> tuple[Program, tuple[PathLimits, ...]]:
    """The program with an output for each bounded value and limit, and these limits. `scales` are
    the typical sizes of states by name.
    """
    builder = GraphBuilder(program.step)
    outputs = list(program.outputs)
    paths: list[PathLimits] = []
    for state in program.states:
        ends = _ends(problem, state)
        if ends == (None, None):
            continue
        names: list[str | None] = []
        for word, end in zip(("least", "most"), ends, strict=True):
            names.append(None if end is None else f"{word} {state.name}")
            if end is not None:
                outputs.append(
                    Output(f"{word} {state.name}", builder.constant(end, unit=state.unit))
                )
        # no name of a spec has a blank: outputs of the window meet none of the model
        value = f"bounded {state.name}"
        outputs.append(Output(value, builder.state(state.name, Type(state.axes, state.unit))))
        paths.append(
            PathLimits(
                name=state.name,
                value=value,
                limits=Limits(minimum=names[0], maximum=names[1]),
                reads_control=False,
                hard=state.name in problem.parameters,
                linear=None,
                quadratic=None,
                scale=scales[state.name],
                span=state.span,
            )
        )
    return replace(program, step=builder.graph(), outputs=tuple(outputs)), tuple(paths)


def _ends(problem: EstimationProblem, state: State) -> tuple[float | None, float | None]:
    if state.name in problem.parameters:
        numbers = problem.parameters[state.name]
        return numbers.minimum, numbers.maximum
    origin = problem.program.state(state.name).origin
    # registers hold samples of others: limits would be said twice
    return state.range if state.range is not None and isinstance(origin, Declared) else (None, None)


# no name of a spec has a blank
NOISE, SPREAD, STARTS, RUNS = "moving noise", "start spread", "stage starts", "stage runs"
_STAGE, _TERMINAL = "cost of stage", "cost of end"
_DRAWN = 10.0
"""Standard deviations of drawn measurements, by which the size of costs is estimated."""
_UNCERTAIN, _NUMBER = "of", "number"
"""Axes of w and v, and of all numbers of ξ."""


@dataclass(frozen=True, slots=True)
class WindowProblem:
    """The optimal control problem of an estimation window with N+1 samples, whose controls are
    noise; it still has parameters.
    """

    control: ControlProblem
    numbers: Vector
    """ξ, the states of the problem."""
    uncertain: tuple[int, ...]
    """The numbers of ξ that w and v move, in the order of w: all but past samples of inputs."""
    inputs: Mapping[str, str]
    """By input of the model the reference that is its sample."""
    signals: tuple[str, ...]
    """What is measured."""

    @staticmethod
    def measured(signal: str) -> str:
        """The name of the reference with the measurements of a signal, which are 0 where it was not
        measured.
        """
        return f"measured {signal}"

    @staticmethod
    def seen(signal: str) -> str:
        """The name of the reference that is 1 for the measured elements of a signal, else 0."""
        return f"seen {signal}"


def window_problem(problem: EstimationProblem) -> WindowProblem:
    """The optimal control problem that estimates the states of an `mhe` problem, over
    its window.
    """
    window = problem.window
    assert window is not None
    program = augmented(problem.program, problem.parameters)
    numbers = vector_of("x", [(s.name, s.axes, s.unit) for s in program.states])
    uncertain = _uncertain(problem, numbers)
    program, inputs = _with_flat_inputs(problem, program)
    # a start is not measured alone: each sample of a window is a reference of its stage
    draft = _Draft(problem, program, numbers, uncertain)
    program = draft.program(inputs)
    scales = _scales(problem, window, program)
    program, limits = with_limits(problem, program, scales)
    samples = [s for s in program.signals if s.name not in (NOISE, SPREAD)]
    control = ControlProblem(
        program=program,
        states=numbers,
        controls=vector_of("u", [(NOISE, (draft.noise_axis,), None)]),
        disturbances=vector_of("d", []),
        references=vector_of("r", [(s.name, s.axes, s.unit) for s in (*samples, draft.spread)]),
        previewed=frozenset(s.name for s in samples),
        stage=_STAGE,
        terminal=_TERMINAL,
        control_limits=(
            ControlLimits(
                name=NOISE, limits=Limits(minimum=None, maximum=None), rate=None, scale=1
            ),
        ),
        path_limits=limits,
        # v is decided a stage before the window, w at each of its samples
        horizon=window.horizon + 1,
        blocks=(1,) * (window.horizon + 1),
        state_scales=scales,
        # exact, but of what is left when errors and F count as linear: that is Gauss and Newton's
        hessian="exact",
        structure="staged",
        mode="fixed" if window.is_fixed else "converged",
        iterations=window.iterations,
        tolerance=window.tolerance,
        flat=frozenset(
            [
                *(next_value(member.name) for member in numbers.members),
                *(f"error of {measurement.signal}" for measurement in problem.measured),
            ]
        ),
    )
    return WindowProblem(
        control=control,
        numbers=numbers,
        uncertain=uncertain,
        inputs=inputs,
        signals=tuple(measurement.signal for measurement in problem.measured),
    )


def _uncertain(problem: EstimationProblem, numbers: Vector) -> tuple[int, ...]:
    registers = problem.registers
    return tuple(
        member.first + number
        for member in numbers.members
        if not isinstance(registers.get(member.name), History)
        for number in range(member.size)
    )


def _with_flat_inputs(
    problem: EstimationProblem, program: Program
) -> tuple[Program, dict[str, str]]:
    """The program in which every input is a single sample: a window of future samples becomes an
    ordinary axis. Also the new name of each input.
    """
    names = {
        member.name: member.name if Type(member.axes).window is None else f"ahead {member.name}"
        for member in problem.inputs.members
    }
    builder = GraphBuilder()
    copies: dict[NodeId, NodeId] = {}
    for index, node in program.step:
        op = node.op
        if isinstance(op, ReadSignal) and node.type.window is not None:
            own = node.type.with_axes(_flat(node.type.axes))
            read = builder.signal(names[op.signal], 0, 0, own)
            copies[index] = builder.reshape(read, node.type.axes)
        # everything but windows of inputs stays as it is
        else:
            copies[index] = copy_node(builder, node, tuple(copies[arg] for arg in node.args))
    known = {signal.name: signal for signal in program.signals}
    signals = tuple(
        replace(known[member.name], name=names[member.name], axes=_flat(member.axes))
        for member in problem.inputs.members
    )
    return replace(with_step(program, builder.graph(), copies), signals=signals), names


def _flat(axes: tuple[Axis, ...]) -> tuple[Axis, ...]:
    return tuple(Axis("ahead", axis.size) if axis.name == WINDOW else axis for axis in axes)


def _scales(problem: EstimationProblem, window: MovingWindow, program: Program) -> dict[str, float]:
    """The typical size of each state: half of its range, else its drift by noise over the window,
    else 1.
    """
    found: dict[str, float] = {}
    known = {**problem.deviations, **problem.parameters}
    seconds = window.horizon * problem.sample_time
    for state in program.states:
        std = known.get(state.name, EstimatedNumbers(initial=0.0, drift=0.0))
        # a walk spreads with the root of time
        size = max(std.initial, std.drift * seconds**0.5) or 1.0
        if state.range is not None and state.range[1] > state.range[0]:
            size = (state.range[1] - state.range[0]) / 2
        found[state.name] = size
    return found


class _Draft:
    """Builds the step of a window's program: the model, driven by noise, and the costs."""

    def __init__(
        self,
        problem: EstimationProblem,
        program: Program,
        numbers: Vector,
        uncertain: tuple[int, ...],
    ) -> None:
        self._problem, self._program = problem, program
        self._numbers, self._uncertain = numbers, uncertain
        self.noise_axis = Axis(_UNCERTAIN, len(uncertain))
        axes = (Axis(_NUMBER, numbers.size), self.noise_axis)
        self.spread = Signal(SPREAD, Role.INPUT, axes)
        self._builder = GraphBuilder(program.step)
        self._noise = self._builder.signal(NOISE, 0, 0, Type((self.noise_axis,)))
        spread = self._builder.signal(SPREAD, 0, 0, Type(axes))
        self._begun = self._builder.contract_over(spread, self._noise, _UNCERTAIN)

    def program(self, inputs: Mapping[str, str]) -> Program:
        """The complete program; `inputs` are the names of the model's inputs in it."""
        b, program = self._builder, self._program
        starts = b.signal(STARTS, 0, 0, Type())
        # references are real numbers: 1 or 0, told apart half-way
        half = b.constant(0.5, unit=None)
        runs = b.compare(Relation.GREATER, b.signal(RUNS, 0, 0, Type()), half)
        states = tuple(
            replace(state, next=self._next(state, starts, runs), origin=Declared())
            # registers are numbers like all others here: v moves them too
            for state in program.states
        )
        rest, errors, measured = self._residuals()
        noise = b.contract_over(self._noise, self._noise, _UNCERTAIN)
        return replace(
            program,
            signals=(
                *(signal for signal in program.signals if signal.name in inputs.values()),
                *measured,
                Signal(STARTS, Role.INPUT),
                Signal(RUNS, Role.INPUT),
                Signal(NOISE, Role.INPUT, (self.noise_axis,)),
                self.spread,
            ),
            states=states,
            # the newest sample is measured, and no noise follows it within the window
            outputs=(Output(_STAGE, b.add(rest, noise)), Output(_TERMINAL, rest), *errors),
            step=b.graph(),
        )

    def _next(self, state: State, starts: NodeId, runs: NodeId) -> NodeId:
        """The next value of a state: F + q √Δt w while the model runs (`runs`), x̄ + S v at the
        start of the window (`starts`), else x̄.

        F is the model's next state, q w its process noise per √s, x̄ the arrival estimate, and S a
        square root of its covariance.
        """
        b, member = self._builder, self._numbers.member(state.name)
        now = b.state(state.name, Type(state.axes, state.unit))
        begun = b.slice(self._begun, _NUMBER, member.first, member.first + member.size)
        moved = b.multiply(starts, b.reshape(begun, state.axes))
        return b.select(runs, self._driven(state), b.add(now, moved))

    def _driven(self, state: State) -> NodeId:
        b = self._builder
        known = {**self._problem.deviations, **self._problem.parameters}
        if state.name not in known or known[state.name].drift == 0:
            return state.next
        member = self._numbers.member(state.name)
        first = self._uncertain.index(member.first)
        own = b.slice(self._noise, _UNCERTAIN, first, first + member.size)
        own = b.reshape(own, state.axes)
        # the variance grows by process² · Δt from sample to sample, its root by √Δt
        size = known[state.name].drift * self._problem.sample_time**0.5
        if not isinstance(state.origin, Tape):
            return b.add(state.next, b.multiply(b.constant(size, unit=None), own))
        # of what is fed back only the newest sample is new
        *axes, last = state.axes
        newest = b.slice(own, WINDOW, last.size - 1, last.size)
        newest = b.multiply(b.constant(size, unit=None), newest)
        # what was fed back before has its noise already
        if last.size > 1:
            before = (*axes, Axis(WINDOW, last.size - 1))
            zeros = b.broadcast(b.constant(0.0, unit=None), before)
            newest = b.concat([zeros, newest], WINDOW)
        return b.add(state.next, newest)

    def _residuals(self) -> tuple[NodeId, list[Output], list[Signal]]:
        """The sum of squares of all measurement errors divided by their standard deviations;
        outputs with these errors, and the references that they read.
        """
        b, program = self._builder, self._program
        total = b.constant(0.0, unit=None)
        signals: list[Signal] = []
        errors: list[Output] = []
        for measurement in self._problem.measured:
            expected = program.output(measurement.value).node
            axes = b.type(expected).axes
            names = (
                WindowProblem.measured(measurement.signal),
                WindowProblem.seen(measurement.signal),
            )
            value, seen = (b.signal(name, 0, 0, Type(axes)) for name in names)
            # numbers drawn for it are a few deviations, in whatever unit
            most = _DRAWN * measurement.std
            signals.append(Signal(names[0], Role.INPUT, axes, range=(-most, most)))
            signals.append(Signal(names[1], Role.INPUT, axes))
            std = b.constant(measurement.std, unit=None)
            error = b.divide(b.subtract(value, expected), std)
            errors.append(Output(f"error of {measurement.signal}", error))
            square = b.power(error, 2)
            # what is not seen may be anything, not finite too
            is_seen = b.compare(Relation.GREATER, seen, b.constant(0.5, unit=None))
            found = b.select(is_seen, square, b.constant(0.0, unit=None))
            # a measurement may be an array: each element has its own mark and its own error
            for axis in axes:
                found = b.sum(found, axis.name)
            total = b.add(total, found)
        return total, errors, signals

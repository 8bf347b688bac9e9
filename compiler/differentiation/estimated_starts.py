"""Builds two programs for initial states that least squares estimate.

`with_read_starts` reads the estimates from series in the data. `with_moved_starts` also adds a
parameter to each; its derivatives are those that least squares need for an estimate.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Parameter, Program, Role, Signal, State
from compiler.ir.types import Type


def start_signal(state: str) -> str:
    """The name of the series in whose row t0 the estimated initial value of a state is, for a
    rollout that starts at row t0.
    """
    return f"{state}.start"


def offset_parameter(state: State) -> str:
    """The name of the parameter, always 0, that is added to the initial values of a state in all
    rollouts.

    The derivative of a rollout with respect to it equals that with respect to the rollout's initial
    value.
    """
    return f"{state.name}.offset"


def estimated_states(program: Program) -> tuple[State, ...]:
    """The states whose initial values are estimated by least squares."""
    return tuple(state for state in program.states if state.fit_over is not None)


def evaluations_that_decide(states: Iterable[State]) -> int | None:
    """Number of first samples of a rollout from which these states are estimated; None for all
    samples, 0 without states.

    All states are estimated together, so the longest `over:` of the spec counts.
    """
    longest = 0
    for state in states:
        if state.fit_over == 0:
            return None
        longest = max(longest, state.fit_over or 0)
    return longest


def with_read_starts(program: Program) -> Program:
    """Reads estimated initial values from separate series.

    Before: window form. After: no state is marked as estimated; each that was starts from row t0 of
    the target `<state>.start`. Example, before and after:

        state x: scalar m, next %1, start %0, fitted over 20   # %0: scalar m = 0

        state x: scalar m, next %1, start %0                   # %0: scalar m = log(x.start, 0, 0)
    """
    return _with_starts(program, {})


def with_moved_starts(program: Program) -> Program:
    """Reads estimated initial values from separate series, and adds to each a parameter
    `<state>.offset`, which is 0.

    One parameter shifts the initial values of all rollouts. The derivative of a rollout with
    respect to it is therefore the derivative with respect to the initial value of that rollout.
    """
    states = estimated_states(program)
    parameters = tuple(
        Parameter(offset_parameter(state), state.axes, state.unit, (0.0,) * Type(state.axes).size)
        for state in states
    )
    moved = replace(program, parameters=(*program.parameters, *parameters))
    return _with_starts(moved, {state.name: offset_parameter(state) for state in states})


def _with_starts(program: Program, offsets: Mapping[str, str]) -> Program:
    builder = GraphBuilder(program.start)
    signals: list[Signal] = []
    states: list[State] = []
    for state in program.states:
        if state.fit_over is None:
            states.append(state)
            continue
        type = Type(state.axes, state.unit)
        name = start_signal(state.name)
        start = builder.log(name, 0, 0, type)
        if state.name in offsets:
            start = builder.add(start, builder.parameter(offsets[state.name], type))
        # a target, since deployed code has no port for it
        signals.append(Signal(name, Role.TARGET, state.axes, state.unit))
        states.append(replace(state, start=start, fit_over=None))
    return replace(
        program,
        signals=(*program.signals, *signals),
        states=tuple(states),
        start=builder.graph(),
    )

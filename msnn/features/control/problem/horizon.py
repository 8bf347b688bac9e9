"""Holds the data of one optimal control problem and plans along its horizon, as arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from compiler.interpreter.interpreter import Interpreter
from compiler.ir.program import Program
from compiler.ir.types import Type
from compiler.jacobian.matrices import by_name
from msnn.features.control.problem.optimal_control import ControlProblem, Limits, PathLimits

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Given:
    """The values that are known at t: the state x_0, and disturbances and references along the
    horizon.
    """

    state: Array
    """(nx)"""
    disturbances: Mapping[str, Array]
    """By name samples t … t+N+ahead, (N+1+ahead, *shape of one sample)."""
    references: Mapping[str, Array]
    """By name samples t … t+N, (N+1, *shape)."""


@dataclass(frozen=True, slots=True)
class Plan:
    """Controls along the horizon, and the states to which they lead, in the units of the spec."""

    states: Array
    """(N+1, nx)"""
    controls: Array
    """(N, nu)"""


@dataclass(frozen=True, slots=True)
class Multipliers:
    """The multipliers of limits, each ≥ 0 and 0 where there is no limit, in the unit of the limit.

    Those of rates belong to u_k − u_{k−1}. Those of path limits are (stages, size), in the order of
    `ControlProblem.path_limits`, at the stages of `stages_of`.
    """

    control_min: Array
    control_max: Array
    rate_min: Array
    rate_max: Array
    path_min: tuple[Array, ...]
    path_max: tuple[Array, ...]


@dataclass(frozen=True, slots=True)
class LimitsAlong:
    """The limits along the horizon: −∞ or +∞ where there is none. Arrays of controls
    are (N, nu).
    """

    control_min: Array
    """(N, nu)"""
    control_max: Array
    path_min: tuple[Array, ...]
    """(stages, size) each."""
    path_max: tuple[Array, ...]


def stages_of(problem: ControlProblem, path: PathLimits) -> slice:
    """The stages k at which a path limit holds."""
    n = problem.horizon
    return slice(0, n) if path.reads_control else slice(1, n + 1)


def block_starts(problem: ControlProblem) -> NDArray[np.bool_]:
    """An array (N): True where controls may change at stage k; otherwise u_k = u_{k−1}."""
    found = np.zeros(problem.horizon, np.bool_)
    # a block starts where those before it end
    found[np.cumsum((0, *problem.blocks[:-1]))] = True
    return found


def log_of(problem: ControlProblem, given: Given, controls: Array) -> dict[str, Array]:
    """The rows 0 … N of the program's inputs, by name, with the controls (N, nu) of a plan; row N,
    which has no control, repeats the last one.
    """
    # at N nothing is decided; stage costs there are not counted, but windows are evaluated
    held = np.concatenate([controls, controls[-1:]])
    log = dict(given.disturbances) | dict(given.references)
    for member in problem.controls.members:
        part = held[:, member.first : member.first + member.size]
        log[member.name] = part.reshape(-1, *Type(member.axes).shape)
    return log


def flat(values: Array) -> Array:
    """Reshapes (rows, *shape) to (rows, size)."""
    return values.reshape(len(values), -1)


def limits_program(problem: ControlProblem) -> Program:
    """The problem's program with only the outputs that compute limits."""
    each = (*problem.control_limits, *problem.path_limits)
    # outputs are found by name: a limit that two bounds share is computed once
    names = {name for one in each for name in (one.limits.minimum, one.limits.maximum)}
    program = problem.program
    outputs = tuple(output for output in program.outputs if output.name in names)
    return replace(program, states=(), outputs=outputs, losses=())


def limits_along(problem: ControlProblem, interpreter: Interpreter, given: Given) -> LimitsAlong:
    """The limits along the horizon for the references in `given`; `interpreter` runs
    `limits_program`, or the complete program.
    """
    n, nu = problem.horizon, problem.controls.size
    # limits read references alone: any controls and states do
    log = log_of(problem, given, np.zeros((n, nu)))
    states = by_name(problem.states, np.zeros((n + 1, problem.states.size)))
    outputs = interpreter.step(log, np.arange(n + 1), states, losses=False).outputs

    def along(limits: Limits, size: int) -> tuple[Array, Array]:
        ends: list[Array] = []
        for name, nothing in ((limits.minimum, -np.inf), (limits.maximum, np.inf)):
            # ∞ compares as no limit does, and no formula needs a special case
            values = np.full((n + 1, 1), nothing) if name is None else flat(outputs[name])
            ends.append(np.broadcast_to(values, (n + 1, size)))
        return ends[0], ends[1]

    low, high = np.empty((n, nu)), np.empty((n, nu))
    for member, control in zip(problem.controls.members, problem.control_limits, strict=True):
        columns = slice(member.first, member.first + member.size)
        ends = along(control.limits, member.size)
        low[:, columns], high[:, columns] = (end[:n] for end in ends)
    paths = [
        tuple(
            end[stages_of(problem, path)]
            for end in along(path.limits, problem.type(path.value).size)
        )
        for path in problem.path_limits
    ]
    return LimitsAlong(low, high, tuple(p[0] for p in paths), tuple(p[1] for p in paths))


def scales(problem: ControlProblem) -> tuple[Array, Array]:
    """The typical change of each element of x (nx) and of u (nu), in their units."""
    states = [np.full(m.size, problem.state_scales[m.name]) for m in problem.states.members]
    sizes = {control.name: control.scale for control in problem.control_limits}
    controls = [np.full(m.size, sizes[m.name]) for m in problem.controls.members]
    return np.concatenate([*states, np.empty(0)]), np.concatenate(controls)


def rates(problem: ControlProblem) -> Array:
    """An array (nu): the largest change of each control from sample to sample; ∞
    without a limit.
    """
    known = {control.name: control.rate for control in problem.control_limits}
    found: list[Array] = []
    for member in problem.controls.members:
        rate = known[member.name]
        # 0 is a limit too: none is where no rate is
        found.append(np.full(member.size, np.inf if rate is None else rate))
    return np.concatenate(found)


def previous_places(problem: ControlProblem) -> NDArray[np.int64]:
    """An array (nu): the index in x of u_{k−1} of each element of u; −1 if x does not
    contain it.
    """
    found = [
        problem.previous(member.name) or (-1,) * member.size for member in problem.controls.members
    ]
    return np.concatenate(found).astype(np.int64)

"""Slopes of a weighted sum of everything a step computes, by four roads.

All work on the step form and have the same variables: ports, states and parameters, by name.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import casadi
import numpy as np
import torch
from numpy.typing import NDArray

from backends.casadi_function.function import build_function, casadi_names
from backends.ports.step_interface import StepInterface, step_interface
from backends.torch_module.module import build_module
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.program import Program
from compiler.jacobian.jacobian import JacobianInterpreter, jacobian
from compiler.passes.to_step_form import to_step_form
from tests.every_op.runners import Log

Array = NDArray[np.float64]
Kind = str
Variables = dict[tuple[Kind, str], Array]
"""Values of `port`, `state` (members, *shape) and `parameter` (*shape) by name."""


@dataclass(frozen=True)
class Problem:
    """A step-form program at some members of a batch, and the weight of every result's element."""

    program: Program
    interface: StepInterface
    variables: Variables
    weights: dict[tuple[Kind, str], Array]

    @property
    def members(self) -> int:
        return next(len(v) for (kind, _), v in self.variables.items() if kind != "parameter")


Gradient = Callable[[Problem], Variables]


def problem(program: Program, log: Log, times: NDArray[np.int64]) -> Problem:
    """The variables' values that the log has at these rows, each row with its own start."""
    program = to_step_form(program)
    interface = step_interface(program)
    variables: Variables = {}
    for port in interface.inputs:
        rows = [log[port.signal.name][t + port.first : t + port.last + 1] for t in times]
        windows = np.moveaxis(np.stack(rows), 1, -1)
        variables["port", port.signal.name] = windows.reshape(-1, *port.type.shape)
    for name, value in Interpreter(program).start(log, times).items():
        variables["state", name] = value.copy()
    for parameter in interface.parameters:
        shape = tuple(axis.size for axis in parameter.axes)
        variables["parameter", parameter.name] = np.reshape(parameter.initial, shape)
    random = np.random.default_rng(7)
    results = {("output", o.name): program.step[o.node].type.shape for o in program.outputs}
    results |= {("next", s.name): program.step[s.next].type.shape for s in program.states}
    weights = {key: random.uniform(0.5, 1.5, shape) for key, shape in results.items()}
    return Problem(program, interface, variables, weights)


def by_differences(p: Problem) -> Variables:
    """Central differences of the interpreter in float64."""
    result: Variables = {}
    for (kind, name), value in p.variables.items():
        slopes = np.zeros_like(value)
        lead = () if kind == "parameter" else (slice(None),)
        for index in np.ndindex(value.shape[len(lead) :]):
            place = (*lead, *index)
            # near the cube root of the rounding error, where both errors of the quotient are small
            step = 1e-6 * np.maximum(np.abs(value[place]), 1e-2)
            above, below = value.copy(), value.copy()
            above[place] += step
            below[place] -= step
            first = _results(p, {**p.variables, (kind, name): above})
            second = _results(p, {**p.variables, (kind, name): below})
            # results that do not change drop out here, before their rounding can show
            change = sum(
                ((first[key] - second[key]) * w).reshape(p.members, -1).sum(1)
                for key, w in p.weights.items()
            )
            width = above[place] - below[place]
            slopes[place] = change / width if kind != "parameter" else np.sum(change) / width
        result[kind, name] = slopes
    return result


def by_torch(p: Problem) -> Variables:
    """Reverse mode of the torch module."""
    module = build_module(p.program, torch.float64)
    frame = module.frame()
    leaves = {
        key: torch.tensor(value, requires_grad=True)
        for key, value in p.variables.items()
        if key[0] != "parameter"
    }
    ports = {port.signal.name: port for port in p.interface.inputs}

    def windows(signal: str, first: int, last: int) -> torch.Tensor:
        port = ports[signal]
        assert (first, last) == (port.first, port.last)
        value = leaves["port", signal]
        return value if port.type.window else value[..., None]

    states = {name: value for (kind, name), value in leaves.items() if kind == "state"}
    values = module.step_on(windows, states, frame, p.members)
    named = {("output", name): value for name, value in values.outputs.items()}
    named |= {("next", name): value for name, value in values.next_states.items()}
    total = torch.zeros((), dtype=torch.float64)
    for key, weight in p.weights.items():
        total = total + (named[key] * torch.tensor(weight)).sum()
    variables = {
        key: leaves[key] if key[0] != "parameter" else frame.physical[key[1]] for key in p.variables
    }
    if not total.requires_grad:
        return {key: np.zeros(value.shape) for key, value in p.variables.items()}
    slopes = torch.autograd.grad(
        total, list(variables.values()), allow_unused=True, materialize_grads=True
    )
    return {key: slope.numpy() for key, slope in zip(variables, slopes, strict=True)}


def by_casadi(p: Problem) -> Variables:
    """Reverse mode of the CasADi function."""
    step, names = build_function(p.program), casadi_names(p.program)
    tables = {"port": names.inputs, "state": names.states, "parameter": names.parameters}
    symbols = {
        step.name_in(i): casadi.MX.sym(step.name_in(i), step.size1_in(i))
        for i in range(step.n_in())
    }
    results = step.call(symbols)
    total = casadi.MX(0)
    for (kind, name), weight in p.weights.items():
        port = names.outputs[name] if kind == "output" else names.next_states[name]
        total = total + casadi.dot(casadi.DM(weight.ravel()), results[port])
    column = casadi.vertcat(*symbols.values())
    gradient = casadi.Function("gradient", list(symbols.values()), [casadi.gradient(total, column)])
    found: Variables = {key: np.zeros_like(value) for key, value in p.variables.items()}
    keys = {tables[kind][name]: (kind, name) for kind, name in p.variables}
    for member in range(p.members):
        arguments = [_member(p, keys[name], member).ravel() for name in symbols]
        slopes = np.split(
            np.array(gradient(*arguments)).ravel(),
            np.cumsum([symbol.numel() for symbol in symbols.values()])[:-1],
        )
        for name, slope in zip(symbols, slopes, strict=True):
            kind, _ = key = keys[name]
            if kind == "parameter":
                found[key] += slope.reshape(found[key].shape)
            else:
                found[key][member] = slope.reshape(found[key].shape[1:])
    return found


def by_jacobian(p: Problem) -> Variables:
    """The weighted rows of the Jacobian in core operations, in the interpreter."""
    slopes = jacobian(p.program, parameters=True)
    log, times, weights, states = log_of_members(p, p.variables)
    judge = JacobianInterpreter(slopes, p.program, weights)
    matrices = judge.matrices(log, times, states)
    found: Variables = {}
    rows = {"x": ("next", slopes.states), "y": ("output", slopes.outputs)}
    row_weights = {
        letter: [x for m in vector.members for x in _weight(p, (kind, m.name), m.size)]
        for letter, (kind, vector) in rows.items()
    }
    letters = {"port": "u", "state": "x", "parameter": "p"}
    for (kind, name), value in p.variables.items():
        total = np.zeros((p.members, value[0].size if kind != "parameter" else value.size))
        for matrix in slopes.matrices:
            if matrix.columns.letter == letters[kind]:
                column = matrix.columns.member(name)
                part = matrices[matrix.name][:, :, column.first : column.first + column.size]
                total += np.einsum("r,brc->bc", row_weights[matrix.rows.letter], part)
        whole = total.sum(0) if kind == "parameter" else total
        found[kind, name] = whole.reshape(value.shape)
    return found


def _weight(p: Problem, result: tuple[Kind, str], size: int) -> list[float]:
    return p.weights.get(result, np.zeros(size)).ravel().tolist()


def _member(p: Problem, key: tuple[Kind, str], member: int) -> Array:
    value = p.variables[key]
    return value if key[0] == "parameter" else value[member]


def _results(p: Problem, variables: Mapping[tuple[Kind, str], Array]) -> Variables:
    log, times, weights, states = log_of_members(p, variables)
    values = Interpreter(p.program, weights).step(log, times, states)
    results = {("output", name): value for name, value in values.outputs.items()}
    return results | {("next", name): value for name, value in values.next_states.items()}


def log_of_members(
    p: Problem, variables: Mapping[tuple[Kind, str], Array]
) -> tuple[dict[str, Array], NDArray[np.int64], dict[str, Array], dict[str, Array]]:
    """A log in which every member has rows of its own, these rows, the weights and the states."""
    ports = p.interface.inputs
    first = min((port.first for port in ports), default=0)
    span = max((port.last for port in ports), default=0) - first + 1
    times = np.arange(p.members) * span - first
    log: dict[str, Array] = {}
    for port in ports:
        values = variables["port", port.signal.name]
        windows = values if port.type.window else values[..., np.newaxis]
        series = np.zeros((p.members * span, *windows.shape[1:-1]))
        for place, offset in enumerate(range(port.first, port.last + 1)):
            series[times + offset] = windows[..., place]
        log[port.signal.name] = series
    weights = {name: v for (kind, name), v in variables.items() if kind == "parameter"}
    states = {name: v for (kind, name), v in variables.items() if kind == "state"}
    return log, times, weights, states

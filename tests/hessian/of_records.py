"""Second derivatives of a weighted sum of what a step computes, by several roads.

The variables are states and ports of a `Problem`, in the order of the compiler's Hessian.
"""

from __future__ import annotations

import numpy as np
import torch

from backends.torch_module.module import build_module
from compiler.hessian.step_derivatives import (
    DerivativeInterpreter,
    DerivativeValues,
    StepDerivatives,
    multiplier,
    next_value,
    step_derivatives,
)
from compiler.jacobian.jacobian import JacobianInterpreter, jacobian
from compiler.jacobian.matrices import Jacobian
from tests.every_op.gradients import Array, Problem, Variables, log_of_members


def derivatives_of(p: Problem, *, hessian: bool = True) -> StepDerivatives:
    return step_derivatives(
        p.program, parameters=[q.name for q in p.interface.parameters], hessian=hessian
    )


def by_compiler(p: Problem, found: StepDerivatives) -> DerivativeValues:
    """Results and matrices (members, rows, columns) of the interpreter."""
    log, times, weights, states = log_of_members(p, p.variables)
    for (kind, name), weight in p.weights.items():
        result = next_value(name) if kind == "next" else name
        states[multiplier(result)] = np.stack([weight] * p.members)
    return DerivativeInterpreter(found, p.program, weights).values(log, times, states)


def first_slopes(p: Problem, variables: Variables) -> tuple[Array, Array]:
    """J (members, results, variables) and λᵀJ, by the rows of `jacobian`."""
    return slopes_of(jacobian(p.program, parameters=True), p, variables)


def slopes_of(slopes: Jacobian, p: Problem, variables: Variables) -> tuple[Array, Array]:
    """As `first_slopes`, for many variables of one problem."""
    log, times, weights, states = log_of_members(p, variables)
    found = JacobianInterpreter(slopes, p.program, weights).matrices(log, times, states)
    of_states = np.concatenate([found["A"], found["B"], found["dx_dp"]], axis=2)
    of_outputs = np.concatenate([found["C"], found["D"], found["dy_dp"]], axis=2)
    whole = np.concatenate([of_states, of_outputs], axis=1)
    ordered = [("next", m.name) for m in slopes.states.members]
    ordered += [("output", m.name) for m in slopes.outputs.members]
    weight = np.concatenate([np.ravel(p.weights[key]) for key in ordered] or [np.zeros(0)])
    return whole, np.einsum("r,brc->bc", weight, whole)


def by_differences(p: Problem, found: StepDerivatives) -> Array:
    """Central differences of the slopes."""
    hessian = np.zeros((p.members, found.variables.size, found.variables.size))
    kinds = {name: kind for kind, name in p.variables}
    slopes = jacobian(p.program, parameters=True)
    for member in found.variables.members:
        kind = kinds[member.name]
        value = p.variables[kind, member.name]
        lead = () if kind == "parameter" else (slice(None),)
        for number, index in enumerate(np.ndindex(value.shape[len(lead) :])):
            place = (*lead, *index)
            # near the cube root of the rounding error, where both errors are small
            step = 1e-6 * np.maximum(np.abs(value[place]), 1e-2)
            above, below = value.copy(), value.copy()
            above[place] += step
            below[place] -= step
            first = slopes_of(slopes, p, {**p.variables, (kind, member.name): above})[1]
            second = slopes_of(slopes, p, {**p.variables, (kind, member.name): below})[1]
            width = np.reshape(above[place] - below[place], (-1, 1))
            hessian[:, member.first + number] = (first - second) / width
    return hessian


def by_torch(p: Problem, found: StepDerivatives) -> Array:
    """torch's own second derivatives, in states and ports; 0 for parameters."""
    module = build_module(p.program, torch.float64)
    frame = module.frame()
    leaves = {
        key[1]: torch.tensor(value, requires_grad=True)
        for key, value in p.variables.items()
        if key[0] != "parameter"
    }
    ports = {port.signal.name: port for port in p.interface.inputs}

    def windows(signal: str, first: int, last: int) -> torch.Tensor:
        port = ports[signal]
        assert (first, last) == (port.first, port.last)
        return leaves[signal] if port.type.window else leaves[signal][..., None]

    states = {s.name: leaves[s.name] for s in p.program.states}
    values = module.step_on(windows, states, frame, p.members)
    named = {("output", name): value for name, value in values.outputs.items()}
    named |= {("next", name): value for name, value in values.next_states.items()}
    total = torch.zeros((), dtype=torch.float64)
    for key, weight in p.weights.items():
        total = total + (named[key] * torch.tensor(weight)).sum()
    hessian = np.zeros((p.members, found.variables.size, found.variables.size))
    members = [member for member in found.variables.members if member.name in leaves]
    if not total.requires_grad:
        return hessian
    wanted = [leaves[member.name] for member in members]
    first = torch.autograd.grad(
        total, wanted, create_graph=True, allow_unused=True, materialize_grads=True
    )
    for row, slope in zip(members, first, strict=True):
        if not slope.requires_grad:
            continue
        for number in range(row.size):
            # members do not depend on one another: the slope of the sum is that of each
            second = torch.autograd.grad(
                slope.reshape(p.members, -1)[:, number].sum(),
                wanted,
                retain_graph=True,
                allow_unused=True,
                materialize_grads=True,
            )
            for column, values_of in zip(members, second, strict=True):
                # what torch knows to be 0 is memory that it never wrote until something is added
                part = (values_of + 0.0).numpy(force=True).reshape(p.members, -1)
                hessian[:, row.first + number, column.first : column.first + column.size] = part
    return hessian

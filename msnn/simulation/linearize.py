"""Linearises a model at one point with the reference interpreter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from backends.ports.step_interface import Port, step_interface
from compiler.hessian.step_derivatives import (
    DerivativeInterpreter,
    StepDerivatives,
    multiplier,
    step_derivatives,
)
from compiler.ir.program import Program
from compiler.jacobian.jacobian import JacobianInterpreter, jacobian
from compiler.jacobian.matrices import Vector
from compiler.passes.simplify import prune_outputs
from compiler.passes.to_step_form import to_step_form
from msnn.data.dataset import FloatArray


@dataclass(frozen=True, slots=True)
class Linearization:
    """Jacobians of one step, x' = f(x, u, p) and y = h(x, u, p), in float64 and the spec's units.

    `vectors["x"].member("v").first` is the row of a quantity in A and its column in C.
    """

    matrices: dict[str, FloatArray]
    """A = ∂x'/∂x, B = ∂x'/∂u, C = ∂y/∂x, D = ∂y/∂u, and dx_dp, dy_dp: (rows, columns) each."""
    vectors: dict[str, Vector]
    """x, u, y and p: names, axes, units and first places of their quantities."""
    hessians: dict[str, FloatArray] = field(default_factory=dict[str, FloatArray])
    """Blocks `xx`, `xu`, `ux`, `uu` of the Hessian of λᵀ[x', y] in x and u, for given multipliers
    λ.
    """

    @property
    def infinite(self) -> tuple[str, ...]:
        """The matrices and Hessians with an infinite or NaN element."""
        named = {**self.matrices, **self.hessians}
        return tuple(name for name, numbers in named.items() if not np.isfinite(numbers).all())


def linearize(
    program: Program,
    inputs: Mapping[str, ArrayLike],
    states: Mapping[str, ArrayLike],
    weights: Mapping[str, FloatArray],
    hessian: Mapping[str, ArrayLike] | None = None,
) -> Linearization:
    """The Jacobians of a program in window form, at given samples of its ports and states.

    `hessian` maps names of outputs and of next states, `next(x)`, to multipliers; missing ones are
    0. Raises ValueError if a value is missing, unknown or of another shape.
    """
    # in step form all that a step depends on is a port or a state
    step = to_step_form(prune_outputs(program, [output.name for output in program.outputs]))
    slopes = jacobian(step, parameters=True)
    ports = step_interface(step).inputs
    given = _arrays("input", inputs, {port.signal.name: port.type.shape for port in ports})
    known = _arrays("state", states, {s.name: tuple(a.size for a in s.axes) for s in step.states})
    # the first row around which the log has room for every port
    row = max([0, *(-port.first for port in ports)])
    log = {port.signal.name: _series(port, given[port.signal.name], row) for port in ports}
    # the interpreters take a batch: one member here
    batch = {name: value[np.newaxis] for name, value in known.items()}
    found = JacobianInterpreter(slopes, step, weights).matrices(log, row, batch)
    vectors = (slopes.states, slopes.inputs, slopes.outputs, slopes.parameters)
    hessians: dict[str, FloatArray] = {}
    if hessian is not None:
        second = step_derivatives(step)
        batch |= _multipliers(second, hessian)
        values = DerivativeInterpreter(second, step, weights).values(log, row, batch)
        hessians = _blocks(values.matrices["H"][0], slopes.states.size)
    return Linearization(
        {name: matrix[0] for name, matrix in found.items()},
        {vector.letter: vector for vector in vectors},
        hessians,
    )


def _multipliers(
    derivatives: StepDerivatives, given: Mapping[str, ArrayLike]
) -> dict[str, FloatArray]:
    """The multiplier of each result, as a batch of size 1."""
    results = derivatives.results.members
    shapes = {result.name: tuple(axis.size for axis in result.axes) for result in results}
    absent = {name: np.zeros(shape) for name, shape in shapes.items() if name not in given}
    values = _arrays("multiplier", {**given, **absent}, shapes)
    return {multiplier(name): value[np.newaxis] for name, value in values.items()}


def _blocks(hessian: FloatArray, states: int) -> dict[str, FloatArray]:
    """The Hessian split into `xx`, `xu`, `ux` and `uu`; its rows and columns are the states, then
    inputs.
    """
    parts = {"x": slice(0, states), "u": slice(states, None)}
    return {
        f"{i}{j}": hessian[row, column] for i, row in parts.items() for j, column in parts.items()
    }


def _arrays(
    kind: str, given: Mapping[str, ArrayLike], shapes: Mapping[str, tuple[int, ...]]
) -> dict[str, FloatArray]:
    # all of them: a state that is left out would be 0 without anybody having said so
    if given.keys() != shapes.keys():
        message = f"values wanted for each {kind} of {sorted(shapes)}, given for {sorted(given)}"
        raise ValueError(message)
    arrays = {name: np.asarray(value, np.float64) for name, value in given.items()}
    for name, array in arrays.items():
        if array.shape != shapes[name]:
            raise ValueError(f"{kind} `{name}` has shape {array.shape}, not {shapes[name]}")
    return arrays


def _series(port: Port, value: FloatArray, row: int) -> FloatArray:
    """Data of one signal in which the step at row `row` reads exactly these samples."""
    samples = value[np.newaxis] if port.type.window is None else np.moveaxis(value, -1, 0)
    # the window is last in a value (R1), and time is first in a log
    series = np.zeros((row + max(port.last, 0) + 1, *samples.shape[1:]))
    series[row + port.first : row + port.last + 1] = samples
    return series

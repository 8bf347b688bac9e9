"""Evaluates the derivatives of a step with numpy: the reference for matrices of all backends."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from compiler.hessian.step_derivatives import StepDerivatives
from compiler.interpreter.interpreter import Interpreter
from compiler.interpreter.operations import Array
from compiler.ir.program import Output, Program


@dataclass(frozen=True, slots=True)
class DerivativeValues:
    """Results by name, (B, *shape), and matrices by name, (B, rows, columns)."""

    results: dict[str, Array]
    matrices: dict[str, Array]


class DerivativeInterpreter:
    """Evaluates the derivatives of a program with weights, as `Interpreter` evaluates the
    program.
    """

    def __init__(
        self,
        derivatives: StepDerivatives,
        program: Program,
        weights: Mapping[str, ArrayLike] | None = None,
        dtype: DTypeLike = np.float64,
    ) -> None:
        self._derivatives = derivatives
        # a node that is the value of two results is computed once, named by its id
        outputs = tuple(Output(str(node), node) for node in dict.fromkeys(derivatives.roots))
        slopes = replace(
            program,
            # no state is stepped; multipliers are passed as states
            states=(),
            step=derivatives.graph,
            outputs=outputs,
            losses=(),
            fits=(),
            expected=(),
        )
        self._interpreter = Interpreter(slopes, weights, dtype)

    def values(
        self, log: Mapping[str, Array], t: ArrayLike, states: Mapping[str, Array]
    ) -> DerivativeValues:
        """The derivatives of the steps at rows t; `states` includes the multipliers."""
        values = self._interpreter.step(log, t, states, losses=False).outputs
        members = len(np.atleast_1d(np.asarray(t)))
        found = self._derivatives
        matrices = {
            matrix.name: matrix.filled(
                {node: values[str(node)] for node in matrix.nodes}, members, self._interpreter.dtype
            )
            for matrix in found.matrices
        }
        return DerivativeValues(
            {name: values[str(node)] for name, node in found.values.items()}, matrices
        )

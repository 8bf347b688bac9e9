"""Evaluates a Jacobian with numpy: the reference for matrices of all backends."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from compiler.interpreter.interpreter import Interpreter
from compiler.interpreter.operations import Array
from compiler.ir.program import Output, Program
from compiler.jacobian.matrices import Jacobian


class JacobianInterpreter:
    """Evaluates the Jacobian of a program with weights, as `Interpreter` evaluates the program."""

    def __init__(
        self,
        jacobian: Jacobian,
        program: Program,
        weights: Mapping[str, ArrayLike] | None = None,
        dtype: DTypeLike = np.float64,
    ) -> None:
        self._jacobian = jacobian
        outputs = tuple(Output(str(node), node) for node in dict.fromkeys(jacobian.roots))
        slopes = replace(
            program,
            states=(),
            step=jacobian.graph,
            outputs=outputs,
            losses=(),
            fits=(),
            expected=(),
        )
        self._interpreter = Interpreter(slopes, weights, dtype)

    def matrices(
        self, log: Mapping[str, Array], t: ArrayLike, states: Mapping[str, Array]
    ) -> dict[str, Array]:
        """The matrices by name, (B, rows, columns), of the steps at rows t from these states."""
        values = self._interpreter.step(log, t, states, losses=False).outputs
        members = len(np.atleast_1d(np.asarray(t)))
        dtype = self._interpreter.dtype
        return {
            matrix.name: matrix.filled(
                {node: values[str(node)] for node in matrix.nodes}, members, dtype
            )
            for matrix in self._jacobian.matrices
        }

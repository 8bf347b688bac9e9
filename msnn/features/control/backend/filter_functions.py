"""Writes the C functions of a Kalman filter: model step and measurements, with their Jacobians.

<prefix>_transition(z, given, results, slopes)      F(ξ, u) and ∂F/∂ξ
<prefix>_measured_<i>(z, given, results, slopes)    h(ξ, u) and ∂h/∂ξ of measurement i
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from backends.c_language.functions import FunctionTable
from backends.c_language.tree import Function
from compiler.hessian.step_derivatives import StepDerivatives, next_value, step_derivatives
from compiler.ir.ops import ReadSignal
from compiler.ir.program import Program
from compiler.jacobian.matrices import Vector
from msnn.features.control.backend.stage_code.array_places import PlacedMatrix
from msnn.features.control.backend.stage_code.function_body import FunctionBody, part, vector_places
from msnn.features.control.problem.state_estimation import EstimationProblem


@dataclass(frozen=True, slots=True)
class FilterFunctions:
    """The C functions of a filter; `read` names the inputs that measured outputs depend on."""

    transition: Function
    measured: tuple[Function, ...]
    read: frozenset[str]

    @property
    def functions(self) -> tuple[Function, ...]:
        return (self.transition, *self.measured)


def filter_functions(
    problem: EstimationProblem, program: Program, numbers: Vector, table: FunctionTable, real: str
) -> FilterFunctions:
    """Writes the functions of a Kalman filter. `program` has no parameters; `numbers` is the layout
    of its states ξ, `real` the C floating-point type. `table` collects the called math kernels.
    """
    # without outputs, the graph has no nodes that only they need
    transition = _slopes(replace(program, outputs=()))
    measured = [
        # no Hessian: an extended Kalman filter uses first derivatives only
        step_derivatives(_measuring(program, m.value), inputs=(), next_states=(), hessian=False)
        for m in problem.measured
    ]
    writer = _Writer(program, numbers, problem.inputs, table, real)
    rows = [next_value(member.name) for member in numbers.members]
    return FilterFunctions(
        writer.function("transition", transition, rows, "Computes the next sample and its slopes."),
        tuple(
            writer.function(
                f"measured_{number}",
                derivatives,
                [measurement.value],
                f"Computes what is expected of {measurement.signal}, and its slopes.",
            )
            for number, (measurement, derivatives) in enumerate(
                zip(problem.measured, measured, strict=True)
            )
        ),
        frozenset(
            node.op.signal
            for derivatives in measured
            for _, node in derivatives.graph
            if isinstance(node.op, ReadSignal)
        ),
    )


def _slopes(program: Program) -> StepDerivatives:
    """Returns the derivatives of next states by states."""
    return step_derivatives(program, inputs=(), hessian=False)


def _measuring(program: Program, value: str) -> Program:
    """Returns the program with the output `value` alone."""
    return replace(program, outputs=(program.output(value),))


@dataclass(frozen=True, slots=True)
class _Writer:
    """Writes functions that share a program, array layouts and a floating-point type."""

    program: Program
    numbers: Vector
    inputs: Vector
    table: FunctionTable
    real: str

    def function(
        self, name: str, derivatives: StepDerivatives, results: Sequence[str], doc: str
    ) -> Function:
        """Writes `<prefix>_<name>`, which stores these results, by name, and their Jacobian with
        respect to ξ.
        """
        places = vector_places("z", self.numbers) | vector_places("given", self.inputs)
        body = FunctionBody(derivatives.graph, self.table, self.program.formulas, places)
        firsts: dict[str, int] = {}
        size = 0
        # results are contiguous, in the order of `results`
        for result in results:
            firsts[result] = size
            size += derivatives.results.member(result).size
        rows = [
            firsts[member.name] + number
            for member in derivatives.results.members
            for number in range(member.size)
        ]
        width = self.numbers.size
        slopes = PlacedMatrix(
            "slopes",
            derivatives.jacobian,
            rows=np.array(rows, np.int64) * width,
            columns=np.arange(width),
            first=0,
            last=size * width,
        )
        values = [(derivatives.values[result], firsts[result]) for result in results]
        stored = [
            (node, part("results", derivatives.graph[node].type, first)) for node, first in values
        ]
        body.write((slopes,), {node: node for node in derivatives.jacobian.nodes}, stored)
        read, written = ("z", "given"), ("results", "slopes")
        return body.finished(name, self.real, read, written, doc)

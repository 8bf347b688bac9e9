"""Writes the functions of a filter in C: the step of the model and what is measured, with slopes.

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
from msnn.features.control.backend.stage_code.function_body import FunctionBody, part, vector_places
from msnn.features.control.backend.stage_code.placed_matrix import PlacedMatrix
from msnn.features.control.problem.state_estimation.problem import EstimationProblem


@dataclass(frozen=True, slots=True)
class FilterFunctions:
    """The functions, and which inputs those of measurements read."""

    transition: Function
    measured: tuple[Function, ...]
    read: frozenset[str]

    @property
    def functions(self) -> tuple[Function, ...]:
        return (self.transition, *self.measured)


def filter_functions(
    problem: EstimationProblem, program: Program, numbers: Vector, table: FunctionTable, real: str
) -> FilterFunctions:
    """Writes the functions of a program without parameters; its states ξ lie as in `numbers`."""
    # the transition needs no outputs: they would keep nodes that it does not compute
    columns = _slopes(replace(program, outputs=()))
    found = [
        # no curvature: an extended filter takes first derivatives only
        step_derivatives(_measuring(program, m.value), inputs=(), next_states=(), hessian=False)
        for m in problem.measured
    ]
    writer = _Writer(program, numbers, problem.inputs, table, real)
    rows = [next_value(member.name) for member in numbers.members]
    return FilterFunctions(
        writer.function("transition", columns, rows, "Computes the next sample and its slopes."),
        tuple(
            writer.function(
                f"measured_{number}",
                derivatives,
                [measurement.value],
                f"Computes what is expected of {measurement.signal}, and its slopes.",
            )
            for number, (measurement, derivatives) in enumerate(
                zip(problem.measured, found, strict=True)
            )
        ),
        frozenset(
            node.op.signal
            for derivatives in found
            for _, node in derivatives.graph
            if isinstance(node.op, ReadSignal)
        ),
    )


def _slopes(program: Program) -> StepDerivatives:
    return step_derivatives(program, inputs=(), hessian=False)


def _measuring(program: Program, value: str) -> Program:
    return replace(program, outputs=(program.output(value),))


@dataclass(frozen=True, slots=True)
class _Writer:
    program: Program
    numbers: Vector
    inputs: Vector
    table: FunctionTable
    real: str

    def function(
        self, name: str, found: StepDerivatives, results: Sequence[str], doc: str
    ) -> Function:
        places = vector_places("z", self.numbers) | vector_places("given", self.inputs)
        body = FunctionBody(found.graph, self.table, self.program.formulas, places)
        firsts: dict[str, int] = {}
        size = 0
        # results stand one after the other in the order in which they are asked for
        for result in results:
            firsts[result] = size
            size += found.results.member(result).size
        rows = [
            firsts[member.name] + number
            for member in found.results.members
            for number in range(member.size)
        ]
        width = self.numbers.size
        slopes = PlacedMatrix(
            "slopes",
            found.jacobian,
            rows=np.array(rows, np.int64) * width,
            columns=np.arange(width),
            first=0,
            last=size * width,
        )
        values = [(found.values[result], firsts[result]) for result in results]
        stored = [(node, part("results", found.graph[node].type, first)) for node, first in values]
        body.write((slopes,), {node: node for node in found.jacobian.nodes}, stored)
        read, written = ("z", "given"), ("results", "slopes")
        return body.finished(name, self.real, read, written, doc)

"""Runs rollouts in a native kernel, which is checked against the interpreter when it is built."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from backends.native.rollout_kernel import RolloutKernel
from backends.native.variables import flat
from compiler.differentiation.training_step import loss_terms
from compiler.interpreter.bounded import Total, exact, unit_roundoff
from compiler.interpreter.interpreter import physical_weights
from compiler.interpreter.rounding import Forward
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Program
from msnn.data.dataset import BoolArray, FloatArray
from msnn.data.rollout_rows import Runs, reach
from msnn.simulation.engines.engine import Advance
from msnn.simulation.engines.kernel_check import (
    LONGEST,
    Weights,
    cases,
    check_if_fresh,
    compare,
)
from msnn.simulation.rollout import LossSum

_MORE = 3
"""Rollouts in addition to a full group of SIMD lanes, to test a partial group too."""

_ROWS = 4096
"""Number of rows on which a new kernel is checked."""


class NativeRollouts:
    """An engine that simulates in compiled C.

    Raises CompilerMissingError if there is no C compiler.
    """

    def __init__(
        self, program: Program, weights: Mapping[str, FloatArray], series: Mapping[str, FloatArray]
    ) -> None:
        self._kernel = RolloutKernel(program)
        self._weights = physical_weights(program, weights)
        self._physical = flat(program, self._weights)
        self._series = series

    def check(self, runs: Runs) -> None:
        """Compares a newly built kernel with the reference interpreter. Raises WrongKernelError."""
        kernel = self._kernel
        check_if_fresh(
            kernel.built, lambda: check_rollouts(kernel, self._series, runs, self._weights)
        )

    def outputs(self, runs: Runs, advance: Advance) -> dict[str, FloatArray]:
        """Every output of the program, rollout after rollout, as views of one array."""
        program = self._kernel.program
        data = self._kernel.data(self._series)
        rolled = self._kernel.run(data, runs.t0, runs.steps, self._physical, advance).outputs
        return _by_name(program, rolled)

    def losses(
        self, runs: Runs, skip: int, scored: Mapping[str, BoolArray] | None, advance: Advance
    ) -> dict[str, LossSum]:
        """Every loss of the program as its sum and count, over steps from `skip` on and `scored`
        rows.
        """
        data = self._kernel.data(self._series, skip, scored)
        rolled = self._kernel.run(data, runs.t0, runs.steps, self._physical, advance)
        found = zip(
            self._kernel.source.losses, rolled.sums.tolist(), rolled.counts.tolist(), strict=True
        )
        return {name: LossSum(total, count) for name, total, count in found}


def check_rollouts(kernel: RolloutKernel, series: Weights, runs: Runs, weights: Weights) -> None:
    """Compares outputs and losses of a kernel with the interpreter's. Raises WrongKernelError."""
    program = kernel.program
    builder = GraphBuilder(program.step)
    terms = loss_terms(builder, program)
    # with the terms of the losses as nodes, which the interpreter evaluates like any other
    judged = replace(program, step=builder.graph())
    wanted = [output.node for output in program.outputs]
    wanted += [node for term in terms for node in (term.total, term.count) if node is not None]
    some, few = _beginning(program, series, runs)
    for case in cases(program, some, few, weights, kernel.lanes + _MORE):
        tried = case.runs
        steps = np.full(len(tried.t0), tried.steps)
        data = kernel.data(tried.log, tried.skip)
        physical = flat(program, case.weights)
        found = kernel.run(data, tried.t0, steps, physical, lambda _: None)
        right = Forward(judged, wanted, case.weights, kernel.dtype).moments(tried)
        members = len(tried.t0)
        for name, values in _by_name(program, found.outputs).items():
            node = next(output.node for output in program.outputs if output.name == name)
            each = values.reshape(members, tried.steps, *values.shape[1:])
            for number, moment in enumerate(right):
                one = moment.values[node].repeated(members)
                off = one.spread(unit_roundoff(kernel.dtype))
                compare(kernel.built, f"the output `{name}`", each[:, number], one.value, off)
        for term, total, count in zip(terms, found.sums, found.counts, strict=True):
            expected, scored = Total(kernel.dtype), Total(kernel.dtype)
            for moment in right[tried.skip :]:
                expected.add(moment.values[term.total].repeated(members))
                each = exact(np.full(members, float(term.elements)))
                count_of = None if term.count is None else moment.values[term.count]
                scored.add(each if count_of is None else count_of.repeated(members))
            name = term.loss.name
            compare(kernel.built, f"the loss `{name}`", total, expected.value, expected.off())
            compare(kernel.built, f"the elements of `{name}`", count, scored.value, scored.off())


def _beginning(program: Program, series: Weights, runs: Runs) -> tuple[Weights, Runs]:
    """A section of the data, and the rollouts that begin in it."""
    # the interpreter is slow and data may have millions of rows: a few reveal a wrong kernel
    far, first = reach(program), int(runs.t0.min())
    begin = first - far.back
    stop = first + _ROWS + max(far.ahead, far.start_ahead)
    few = runs.take(np.flatnonzero(runs.t0 < first + _ROWS - LONGEST))
    steps = np.minimum(few.steps, LONGEST)
    piece = {name: values[begin:stop] for name, values in series.items()}
    return piece, replace(few, t0=few.t0 - begin, steps=steps)


def _by_name(program: Program, rolled: FloatArray) -> dict[str, FloatArray]:
    """Splits the columns of all outputs, (steps, elements), into an array (steps, *shape) per
    output.
    """
    found: dict[str, FloatArray] = {}
    begin = 0
    for output in program.outputs:
        type = program.step[output.node].type
        # views: outputs of a long log are most of the memory
        columns = rolled[:, begin : begin + type.size]
        found[output.name] = columns.reshape(len(rolled), *type.shape)
        begin += type.size
    return found

"""Computes how the residuals of each run depend on its initial state, by a kernel if faster."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from backends.files.c_compiler import CompilerMissingError
from compiler.differentiation.sensitivities import LossResiduals, sensitivities
from compiler.differentiation.training_step import SIZE_OF
from compiler.interpreter.interpreter import Interpreter, physical_weights
from compiler.ir.program import Output, Program
from compiler.ir.types import Type
from msnn.data.dataset import BoolArray, FloatArray, IntArray
from msnn.data.rollout_rows import Runs
from msnn.errors.learning import engines
from msnn.simulation.engines.open_rollouts import interpreter_seconds, kernel_seconds
from msnn.simulation.rollout import moments
from spec_schema.diagnostics.diagnostic import Diagnostic

if TYPE_CHECKING:
    from backends.native.sensitivity_kernel import SensitivityKernel

Series = Mapping[str, FloatArray]
Rows = Mapping[str, BoolArray]
SumsOfRuns = Callable[[Runs], Mapping[str, "RunSums"]]

_SEARCH = 4
"""Evaluations per search: two or three steps, and the final point."""


class StartProducts:
    """Computes the residuals of rollouts and their derivatives in the initial states."""

    def __init__(
        self,
        moved: Program,
        offsets: Mapping[str, str],
        *,
        repeats: int,
        native: bool,
    ) -> None:
        """`offsets` maps each series of initial states to the parameter that shifts it.

        A kernel is used for `repeats` searches; without `native`, none is built.
        """
        self._moved, self._offsets = moved, dict(offsets)
        self._judged, residuals = with_slopes(moved, [*offsets.values()])
        self._losses = tuple(one.loss.name for one in residuals)
        self._numbers = sum(Type(moved.parameter(name).axes).size for name in offsets.values())
        self._repeats, self._native = repeats, native
        self._kernel: SensitivityKernel | None = None
        self.notes: tuple[Diagnostic, ...] = ()
        """The reason why a useful kernel is not available."""

    def on(
        self, log: Series, runs: Runs, weights: Series | None, skip: int, rows: Rows | None
    ) -> SumsOfRuns:
        """A function that returns the sums of selected rollouts, from step `skip` on.

        `log` contains the series of initial states, which may change between two calls. `rows`
        limits each loss to a mask of rows.
        """
        seconds = _SEARCH * self._repeats * interpreter_seconds(self._judged, runs)
        # by what is asked alone: a training that goes on takes the way that it took before
        if self._native and seconds > kernel_seconds(self._judged):
            kernel = self._made(log, runs, physical_weights(self._moved, weights or {}))
            if kernel is not None:
                return self._by_kernel(kernel, log, weights or {}, skip, rows)
        judge = Interpreter(self._judged, weights)
        return lambda some: self._interpreted(judge, log, some, skip, rows)

    def _made(self, log: Series, runs: Runs, weights: Series) -> SensitivityKernel | None:
        """The kernel; None if it cannot be built."""
        if self._kernel is not None:
            return self._kernel
        # jinja2 and the emitter are loaded only where kernels are made
        from backends.native.sensitivity_kernel import (
            SensitivityKernel,
            StackTooSmallError,
        )
        from msnn.simulation.engines.kernel_check import (
            NO_FALLBACK,
            check_if_fresh,
            check_sensitivities,
        )

        try:
            found = sensitivities(self._moved, [*self._offsets.values()])
            kernel = SensitivityKernel(found)
            check_if_fresh(
                kernel.built, lambda: check_sensitivities(kernel, found, log, runs, weights)
            )
            self._kernel = kernel
        except (CompilerMissingError, StackTooSmallError):
            self._native = False
        # a wrong kernel must not cost the result: the interpreter can give it, and the fault is
        # told
        except Exception as error:
            if os.environ.get(NO_FALLBACK):
                raise
            self._native = False
            reason = f"{type(error).__name__}: {str(error).strip()}".partition("\n")[0]
            told = f"{reason} (a mistake of msnn: please report it with the spec)"
            self.notes = (engines.interpreted_instead(told),)
        return self._kernel

    def _by_kernel(
        self,
        kernel: SensitivityKernel,
        log: Series,
        weights: Series,
        skip: int,
        rows: Rows | None,
    ) -> SumsOfRuns:
        from backends.native.variables import flat

        sized = rows
        if rows is not None:
            sized = {**rows, **{f"{SIZE_OF}{name}": rows[name] for name in self._losses}}
        data = kernel.data(log, skip, sized)
        physical = flat(self._moved, physical_weights(self._moved, weights))

        def products(runs: Runs) -> Mapping[str, RunSums]:
            data.write({name: log[name] for name in self._offsets})
            found = kernel.products_of_runs(data, runs.t0, runs.steps, physical, self._numbers)
            return {
                name: RunSums(
                    squares=found[name].squares,
                    slope=found[name].blocks.slope,
                    curvature=found[name].blocks.curvature,
                    size=found[f"{SIZE_OF}{name}"].cost,
                    count=found[name].count,
                )
                for name in self._losses
            }

        return products

    def _interpreted(
        self, judge: Interpreter, log: Series, runs: Runs, skip: int, rows: Rows | None
    ) -> Mapping[str, RunSums]:
        sums = {name: RunSums.of_zeros(len(runs), self._numbers) for name in self._losses}
        for moment in moments(judge, log, runs, losses=False):
            for name, one in sums.items() if moment.number >= skip else ():
                some = np.ones(len(moment.t), np.bool_) if rows is None else rows[name][moment.t]
                one.add(name, moment.values.outputs, moment.members, some)
        return sums


@dataclass(slots=True)
class RunSums:
    """The sums of one loss for each rollout: rᵀr, Kᵀr, KᵀK, squared targets, counts.

    r are residuals and K their derivatives in the initial state.
    """

    squares: FloatArray
    slope: FloatArray
    curvature: FloatArray
    size: FloatArray
    count: FloatArray

    @classmethod
    def of_zeros(cls, members: int, numbers: int) -> RunSums:
        shapes = ((members,), (members, numbers), (members, numbers, numbers))
        squares, slope, curvature = map(np.zeros, shapes)
        return cls(squares, slope, curvature, np.zeros(members), np.zeros(members))

    def add(
        self, loss: str, values: Mapping[str, FloatArray], members: IntArray, some: BoolArray
    ) -> None:
        """Adds one step of the rollouts `members`, of which only those in the mask `some` count.

        `values` are the residuals and derivatives of that step, by name.
        """
        values = {name: value[some] for name, value in values.items()}
        members, runs = members[some], int(some.sum())
        if not runs:  # all of them are in rows that do not decide
            return
        error = values[f"{RESIDUAL}{loss}"].reshape(runs, -1)
        slopes = values[f"{SLOPES}{loss}"].reshape(runs, self.slope.shape[1], -1)
        self.squares[members] += np.sum(error * error, axis=1)
        # each run stands in a moment once, so that no sum is lost by indexing
        self.slope[members] += np.einsum("rne,re->rn", slopes, error)
        self.curvature[members] += slopes @ slopes.transpose(0, 2, 1)
        self.size[members] += values[f"{_SIZE}{loss}"]
        # of evaluations whose target is there; missing ones have residual 0
        self.count[members] += values[f"{COUNT}{loss}"]


RESIDUAL, SLOPES, _SIZE, COUNT = "residual of ", "slopes of ", "size of ", "count of "
"""Prefixes of names of losses, for outputs of the program."""


def with_slopes(moved: Program, names: Sequence[str]) -> tuple[Program, tuple[LossResiduals, ...]]:
    """The program whose outputs are residuals, their Jacobians in parameters, sizes and counts."""
    found = sensitivities(moved, names)
    outputs: list[Output] = []
    terms = {term.loss.name: term for term in found.losses}
    for one in found.residuals:
        name, term = one.loss.name, terms[one.loss.name]
        assert term.count is not None, "targets can be missing"
        outputs += [
            Output(f"{RESIDUAL}{name}", one.values),
            Output(f"{SLOPES}{name}", one.slopes),
            Output(f"{_SIZE}{name}", terms[f"{SIZE_OF}{name}"].total),
            Output(f"{COUNT}{name}", term.count),
        ]
    program = replace(found.program, outputs=tuple(outputs), losses=(), expected=(), fits=())
    return program, found.residuals

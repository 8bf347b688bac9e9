"""Trains in generated C code; a stage falls back to torch if that code is wrong."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np

from backends.files.c_compiler import CompilerMissingError
from backends.native.kernel import Kernel
from backends.native.kernel_data import Groups, KernelData
from backends.native.sensitivity_kernel import StackTooSmallError
from backends.native.variables import Method, Rule
from msnn.data.dataset import BoolArray, FloatArray, IntArray
from msnn.data.rollout_rows import Runs
from msnn.errors.learning import engines
from msnn.errors.learning import training as errors
from msnn.simulation.engines.kernel_check import (
    NO_FALLBACK,
    WrongKernelError,
    check_if_fresh,
    check_kernel,
)
from msnn.simulation.rollout import LossSum
from msnn.training.engines.engine import (
    EngineState,
    LossSums,
    NonFiniteLossError,
    factors_of,
    own_series,
)
from msnn.training.plans.loss_terms import known_of
from msnn.training.plans.stage_plan import StagePlan
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError
from spec_schema.sections.optimizers import (
    Adam,
    AdamW,
    Lbfgs,
    LevenbergMarquardt,
    Sgd,
    TorchOptimizer,
)

BATCHES_A_CALL = 200
"""Maximum number of batches between two checks for interrupts and the time limit."""


class NativeEngine:
    """An engine whose C kernel computes losses, gradients and optimiser steps of whole epochs.

    It trains the parameters `plan.trained`; the others keep their values. Raises
    CompilerMissingError if there is no C compiler.
    """

    finished: str | None = None
    left_out = 0
    has_left_out = False

    def __init__(
        self,
        plan: StagePlan,
        series: Mapping[str, FloatArray],
        weights: Mapping[str, FloatArray],
        train_rows: Mapping[str, BoolArray] | None,
        evaluation_rows: Mapping[str, BoolArray] | None,
    ) -> None:
        self._plan = plan
        lbfgs = isinstance(plan.optimizer, Lbfgs)
        # a batch is many steps of L-BFGS, mostly from all starts
        self.batches_a_call = 1 if lbfgs else BATCHES_A_CALL
        self._fixed = {n: value for n, value in weights.items() if n not in plan.trained}
        self._kernel = Kernel(
            plan.program, plan.dtype, plan.threads, reproducible=plan.reproducible, lbfgs=lbfgs
        )
        rule, rate = _rule(plan)
        rates = {name: rate * plan.lr_factors.get(name, 1.0) for name in plan.trained}
        known = known_of(plan, plan.program.parameters)
        self._variables = self._kernel.variables(rule, weights, rates, known)
        self.moved = self._variables.moved
        series = own_series(plan, series)
        self._train = self._kernel.data(own_series(plan, series), plan.rollout.skip, train_rows)
        self._evaluation = self._kernel.data(series, plan.rollout.skip, evaluation_rows)
        names = self._kernel.source.losses
        self._loss_weights = [plan.loss_weights[name] for name in names]
        self._series, self._train_rows = series, train_rows
        self._measured: KernelData | None = None
        self._evaluated: tuple[Runs, Groups] | None = None
        """The grouped rollouts of the last evaluation; the next evaluation usually uses the
        same.
        """

    def check(self, runs: Runs) -> None:
        """Compares a newly built kernel with the reference interpreter on some of these rollouts.

        Raises WrongKernelError if they differ.
        """
        kernel, weights = self._kernel, self.weights()
        check_if_fresh(kernel.built, lambda: check_kernel(kernel, self._series, runs, weights))

    def weights(self) -> dict[str, FloatArray]:
        """Physical values of all parameters; untrained ones are returned exactly as given."""
        return {**self._variables.weights(), **self._fixed}

    def begin_epoch(self, epoch: int, rate: float, attempt: int = 0, spread: float = 0.0) -> None:
        """See `Engine.begin_epoch`."""
        self._train.write(factors_of(self._plan, self._series, epoch, attempt))
        self._variables.scale_rates(rate)
        self._variables.set_spread(spread)

    def measure(self, runs: Runs) -> LossSums:
        """The losses of training rollouts at the current weights, without dropout."""
        if self._measured is None:
            series, skip = self._series, self._plan.rollout.skip
            self._measured = self._kernel.data(series, skip, self._train_rows)
        return self._losses(self._measured, self._kernel.groups(runs.t0, runs.steps))

    def write(self, series: Mapping[str, FloatArray], *, watched: bool) -> None:
        """Overwrites the series of initial states (see `Engine.write`)."""
        (self._evaluation if watched else self._train).write(series)
        if not watched:
            self._series |= series
            if self._measured is not None:
                self._measured.write(series)

    def train_batches(
        self,
        runs: Runs,
        size: int,
        members: IntArray | None = None,
        before: LossSums | None = None,
    ) -> LossSums:
        """Takes one optimiser step per batch; returns the summed losses before the steps.

        Raises NonFiniteLossError.
        """
        steps = int(runs.steps[0]) if runs.uniform else runs.steps
        groups, bounds = self._kernel.batches(runs.t0, steps, size, members)
        earlier = [(before or {}).get(n, LossSum(0.0, 0)) for n in self._kernel.source.losses]
        sums = np.array([each.total for each in earlier], float)
        counts = np.array([each.count for each in earlier], float)
        optimizer = self._variables.optimizer
        optimizer.left_out = 0
        done, sums, counts = self._kernel.train(
            self._train,
            groups,
            bounds,
            self._variables,
            self._loss_weights,
            (sums, counts),
            ranks=self._plan.ranks,
        )
        self.left_out = int(optimizer.left_out)
        self.has_left_out = self.has_left_out or self.left_out > 0
        if done < len(bounds) - 1:
            order = np.arange(len(runs)) if members is None else members
            raise NonFiniteLossError(runs.take(order[done * size : (done + 1) * size]))
        return self._named(sums, counts)

    def order(self, count: int, key: int) -> IntArray:
        """The shuffled indices 0 … count−1 of an epoch's rollouts; `key` seeds the shuffle
        (`epochs.shuffled`).
        """
        return self._kernel.shuffled(count, key)

    def evaluate(self, runs: Runs) -> LossSums:
        """The losses of these rollouts at the current weights, on the rows of the monitor's set."""
        if self._evaluated is None or self._evaluated[0] is not runs:
            self._evaluated = runs, self._kernel.groups(runs.t0, runs.steps)
        return self._losses(self._evaluation, self._evaluated[1])

    def state(self) -> EngineState:
        """A copy of the raw variables and of the optimiser's memory and step counts."""
        kept = {name: array.copy() for name, array in self._variables.remembered.items()}
        counts = {name: getattr(struct, name) for struct, name in self._variables.counts}
        return EngineState(kept, {"engine": "native", **counts})

    def restore(self, state: EngineState) -> None:
        """Sets variables and optimiser to a state of the same stage; KeyError or ValueError for any
        other.
        """
        if not isinstance(state.structure, dict) or state.structure.get("engine") != "native":
            message = "the checkpoint is of another engine"
            raise ValueError(message)
        for name, array in self._variables.remembered.items():
            array[:] = state.arrays[name]
        for struct, name in self._variables.counts:
            setattr(struct, name, state.structure[name])
        self._kernel.fill_in_physical(self._variables)

    def _losses(self, data: KernelData, groups: Groups) -> LossSums:
        physical, weights = self._variables.physical, self._loss_weights
        ranks = self._plan.ranks
        found = self._kernel.losses(data, groups, physical, weights, gradient=False, ranks=ranks)
        return self._named(found.sums, found.counts)

    def _named(self, sums: FloatArray, counts: FloatArray) -> LossSums:
        return {
            name: LossSum(float(total), float(count))
            for name, total, count in zip(self._kernel.source.losses, sums, counts, strict=True)
        }


def _rule(plan: StagePlan) -> tuple[Rule, float]:
    """The optimiser of the stage as the settings of a kernel, and its learning rate."""
    decay, clip, lr = plan.weight_decay, plan.clip or 0.0, plan.lr
    assert lr is not None, "what steps inside of a kernel has a rate"
    match plan.optimizer:
        case Adam(beta1=b1, beta2=b2, eps=eps):
            return Rule(
                method=Method.ADAM, beta1=b1, beta2=b2, epsilon=eps, decay=decay, clip=clip
            ), lr
        case AdamW(beta1=b1, beta2=b2, eps=eps):
            return Rule(
                method=Method.ADAMW, beta1=b1, beta2=b2, epsilon=eps, decay=decay, clip=clip
            ), lr
        case Sgd(momentum=momentum):
            return Rule(method=Method.SGD, beta1=momentum, decay=decay, clip=clip), lr
        case Lbfgs(history=history, iterations=iterations):
            return Rule(
                method=Method.LBFGS,
                decay=decay,
                clip=clip,
                history=history,
                iterations=iterations,
            ), lr
        case TorchOptimizer() | LevenbergMarquardt():
            raise AssertionError("these take the slopes of a kernel and step outside of it")


Made = TypeVar("Made")


@dataclass(frozen=True, slots=True)
class Attempt(Generic[Made]):
    """The result of building kernels: what `make` returned, or None if the stage needs torch."""

    made: Made | None
    plan: StagePlan
    """The stage as it will run."""
    notes: tuple[Diagnostic, ...]


def try_natively(
    plan: StagePlan, make: Callable[[StagePlan], Made], *, in_double: bool
) -> Attempt[Made]:
    """Builds kernels with `make`, which checks them; falls back to float64, then to torch, if they
    are wrong.

    A wrong kernel never ends a training: `Attempt.notes` report it. float64 is tried if `in_double`
    and the stage computes in float32. Raises CompilerMissingError, and SpecError if the spec
    requires `engine: native`.
    """
    try:
        return Attempt(make(plan), plan, ())
    # not a wrong kernel: the caller handles a missing compiler
    except (CompilerMissingError, SpecError):
        raise
    except WrongKernelError as error:
        _raise_if_asked(error)
        if in_double and plan.dtype == "float32":
            note = engines.wrong_kernel(plan.name, str(error), "in float64", plan.span)
            # at most once, as float64 has no wider type to go on to
            other = try_natively(replace(plan, dtype="float64"), make, in_double=False)
            resolved = on_torch(plan) if other.made is None else other.plan
            return Attempt(other.made, resolved, (note, *other.notes))
        note = engines.wrong_kernel(plan.name, str(error), "with torch", plan.span)
    except StackTooSmallError as error:
        reason = str(error)
        if plan.engine == "native":
            raise SpecError((errors.no_native_engine(plan.name, reason, plan.span),)) from error
        note = engines.kernel_not_made(plan.name, reason, plan.span, too_large=True)
    except Exception as error:
        _raise_if_asked(error)
        reason = f"{type(error).__name__}: {str(error).strip()}".partition("\n")[0]
        if plan.engine == "native":
            raise SpecError((errors.no_native_engine(plan.name, reason, plan.span),)) from error
        note = engines.kernel_not_made(plan.name, reason, plan.span)
    return Attempt(None, on_torch(plan), (note,))


def on_torch(plan: StagePlan) -> StagePlan:
    """The plan of the same stage with `engine: torch`."""
    return replace(plan, engine="torch")


def _raise_if_asked(error: Exception) -> None:
    if os.environ.get(NO_FALLBACK):
        raise error

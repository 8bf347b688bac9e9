"""Trains in torch: an optimiser updates raw variables by the gradient of an objective."""

from __future__ import annotations

import math
from collections.abc import Generator, Mapping
from contextlib import contextmanager

import numpy as np
import torch
from torch import Tensor

from backends.torch_module.module import build_module
from compiler.ir.slopes import LARGEST_SLOPE
from msnn.data.dataset import BoolArray, FloatArray, IntArray
from msnn.data.rollout_rows import Runs
from msnn.training.engines.engine import (
    EngineState,
    LossSums,
    NonFiniteLossError,
    batches_of,
    factors_of,
)
from msnn.training.engines.torch.objectives import KernelObjective, KnownSteps, TorchObjective
from msnn.training.engines.torch.torch_optimizers import (
    flattened,
    placed_like,
    rebuilt,
    torch_optimizer,
)
from msnn.training.plans.epochs import shuffled
from msnn.training.plans.stage_plan import StagePlan
from spec_schema.sections.optimizers import (
    Adam,
    AdamW,
    Lbfgs,
    LevenbergMarquardt,
    Sgd,
    TorchOptimizer,
)

_DTYPES = {"float32": torch.float32, "float64": torch.float64}
# times the first total of a batch: what a line search sees where there is no number
_WALL = 1e6


class _NoStep(Exception):  # noqa: N818  (an event, no error)
    """The gradient of a batch is infinite, so the batch is skipped."""


class TorchEngine:
    """An engine whose optimiser is written in torch; losses and gradients come from torch or a
    kernel.

    It trains the parameters `plan.trained`; the others keep their values.
    """

    batches_a_call = 1
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
        objective: type[TorchObjective | KernelObjective] = TorchObjective,
    ) -> None:
        dtype = _DTYPES[plan.dtype]
        self._plan, self._number = plan, np.dtype(plan.dtype).type
        # a rate of 0 holds a parameter where it is
        moving = {name for name in plan.trained if plan.lr_factors.get(name) != 0}
        self._fixed = {n: value for n, value in weights.items() if n not in moving}
        self._model = build_module(plan.program, dtype, plan.device)
        self.moved = self._model.load_physical(weights, moving)
        self._variables = self._select()
        self._optimizer = _optimizer(plan, self._variables)
        self._series = series
        self._rates = [float(group["lr"]) for group in self._optimizer.param_groups]
        parameters = plan.program.parameters
        self._known = KnownSteps(plan, [p for p in parameters if p.name in plan.trained])
        self._spread = 0.0
        self._objective = objective(self._model, plan, series, train_rows, evaluation_rows)

    def _select(self) -> dict[str, Tensor]:
        variables: dict[str, Tensor] = {}
        for parameter in self._plan.program.parameters:
            trained = parameter.name in self._plan.trained
            raw = self._model.raw(parameter.name)
            raw.requires_grad_(trained)
            if trained:
                variables[parameter.name] = raw
        return variables

    def check(self, runs: Runs) -> None:
        """Compares the kernels, if any, with the reference interpreter. Raises WrongKernelError."""
        self._objective.check(runs)

    def weights(self) -> dict[str, FloatArray]:
        """Physical values; untrained parameters keep exactly their given values."""
        return {**self._model.weights(), **self._fixed}

    def begin_epoch(self, epoch: int, rate: float, attempt: int = 0, spread: float = 0.0) -> None:
        """See `Engine.begin_epoch`."""
        self._spread = spread
        self._objective.write(factors_of(self._plan, self._series, epoch, attempt))
        for group, usual in zip(self._optimizer.param_groups, self._rates, strict=True):
            group["lr"] = rate * usual

    def write(self, series: Mapping[str, FloatArray], *, watched: bool) -> None:
        """Overwrites the series of initial states (see `Engine.write`)."""
        self._objective.write(series, watched=watched)

    def train_batches(
        self,
        runs: Runs,
        size: int,
        members: IntArray | None = None,
        before: LossSums | None = None,
    ) -> LossSums:
        """Takes one optimiser step per batch; returns the losses before each step, added to
        `before`.

        Raises NonFiniteLossError.
        """
        runs = runs if members is None else runs.take(members)
        sums = dict(before or {})
        self.left_out = 0
        for batch in batches_of(runs, size):
            for name, value in self._train_batch(batch).items():
                sums[name] = sums[name] + value if name in sums else value
        return sums

    def _train_batch(self, runs: Runs) -> LossSums:
        before: LossSums = {}
        height = 0.0

        def closure() -> Tensor:
            nonlocal before, height
            self._forget_slopes()
            found = self._objective.scored(runs)
            total = found.total + self._known.terms(self._variables, self._spread)
            finite = math.isfinite(total.item())
            is_first = not before
            if is_first:
                if not finite:
                    raise NonFiniteLossError(runs)
                before, height = found.losses, _WALL * (1.0 + abs(total.item()))
            elif not finite:  # a trial step of a line search went too far: a wall sends it back
                return total.new_tensor(height)
            if total.requires_grad:
                total.backward()
                self._hold()
            # before clipping: the factor of an infinite norm is 0, and 0 · ∞ is NaN
            if self._is_steep():
                if is_first:
                    raise _NoStep
                self._forget_slopes()
                return total.new_tensor(height)
            if self._plan.clip is not None:
                torch.nn.utils.clip_grad_norm_(self._variables.values(), self._plan.clip)
            return total

        with _one_thread():
            try:
                # its annotation says float, its code takes the tensor
                self._optimizer.step(closure)  # pyright: ignore[reportArgumentType, reportCallIssue]
                self._known.follow(self._variables, self._optimizer, self._spread)
            except _NoStep:  # an optimiser asks for slopes before it changes anything
                self.left_out += 1
                self.has_left_out = True
        return before

    def _forget_slopes(self) -> None:
        # what `zero_grad` does, without its notes for torch's profiler
        for raw in self._variables.values():
            raw.grad = None

    def _hold(self) -> None:
        """Removes the gradients of variables with learning rate 0, so that torch does not change
        them.

        0 times an infinite derivative is NaN, and some optimisers scale steps by more than the
        rate.
        """
        for group in self._optimizer.param_groups:
            if self._number(group["lr"]) == 0:
                for raw in group["params"]:
                    raw.grad = None

    def _is_steep(self) -> bool:
        """True if the gradient of the current batch is infinite or NaN and the program can cause
        that.
        """
        if not self._objective.has_infinite_slopes:
            return False
        slopes = [raw.grad for raw in self._variables.values() if raw.grad is not None]
        squares = sum(float(slope.double().square().sum()) for slope in slopes)
        return not squares <= LARGEST_SLOPE * LARGEST_SLOPE  # true of NaN

    def order(self, count: int, key: int) -> IntArray:
        """The shuffled indices 0 … count−1 of an epoch's rollouts; `key` seeds the shuffle
        (`epochs.shuffled`).
        """
        return shuffled(count, key)

    def evaluate(self, runs: Runs) -> LossSums:
        """The losses of these rollouts at the current weights, on the rows of the monitor's set."""
        with _one_thread():
            return self._objective.evaluate(runs)

    def measure(self, runs: Runs) -> LossSums:
        """The losses of training rollouts at the current weights, without dropout."""
        with _one_thread():
            return self._objective.measure(runs)

    def state(self) -> EngineState:
        """A copy of the raw variables and of the optimiser's state, for a checkpoint."""
        variables = {name: raw.detach() for name, raw in self._variables.items()}
        return flattened({"variables": variables, "optimizer": self._optimizer.state_dict()})

    def restore(self, state: EngineState) -> None:
        """Sets parameters and optimiser to a state that `state` returned in the same stage."""
        content = rebuilt(state)
        with torch.no_grad():
            for name, raw in self._variables.items():
                raw.copy_(content["variables"][name])
        self._optimizer.load_state_dict(content["optimizer"])
        # torch gives what it loads the dtype of the variable, also where the optimiser has another
        moved = [raw for group in self._optimizer.param_groups for raw in group["params"]]
        for number, kept in content["optimizer"]["state"].items():
            loaded = self._optimizer.state[moved[number]]
            loaded.update(placed_like(kept, dict(loaded)))


def _optimizer(plan: StagePlan, variables: Mapping[str, Tensor]) -> torch.optim.Optimizer:
    decay, lr = plan.weight_decay, plan.lr
    assert lr is not None, "an optimiser of torch has a rate"
    match plan.optimizer:
        case Adam(beta1=b1, beta2=b2, eps=eps):
            groups = _groups(plan, variables, lr)
            return torch.optim.Adam(
                groups, lr=lr, betas=(b1, b2), eps=eps, weight_decay=decay, foreach=False
            )
        case AdamW(beta1=b1, beta2=b2, eps=eps):
            groups = _groups(plan, variables, lr)
            return torch.optim.AdamW(
                groups, lr=lr, betas=(b1, b2), eps=eps, weight_decay=decay, foreach=False
            )
        case Sgd(momentum=momentum):
            groups = _groups(plan, variables, lr)
            return torch.optim.SGD(groups, lr=lr, momentum=momentum, weight_decay=decay)
        case TorchOptimizer():
            return torch_optimizer(plan.optimizer, _groups(plan, variables, lr), decay)
        case Lbfgs(history=history, iterations=iterations):
            return torch.optim.LBFGS(
                list(variables.values()),
                lr=lr,
                max_iter=iterations,
                history_size=history,
                line_search_fn="strong_wolfe",
                # small models are fitted to more digits than the defaults of torch ask for
                tolerance_grad=1e-12,
                tolerance_change=1e-14,
            )
        case LevenbergMarquardt():
            raise AssertionError("it takes the slopes of residuals, not of their sum")


def _groups(plan: StagePlan, variables: Mapping[str, Tensor], lr: float) -> list[dict[str, object]]:
    """The parameter groups of a torch optimiser: one for each learning rate."""
    by_rate: dict[float, list[Tensor]] = {}
    for name, raw in variables.items():
        by_rate.setdefault(lr * plan.lr_factors.get(name, 1.0), []).append(raw)
    return [{"params": raws, "lr": rate} for rate, raws in by_rate.items()]


@contextmanager
def _one_thread() -> Generator[None]:
    """Limits torch to one thread: small models are faster, and sums have a fixed order."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)

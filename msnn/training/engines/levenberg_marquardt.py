"""Steps by Levenberg-Marquardt: damped Gauss-Newton on all rollouts of a stage at once.

A step δ of the raw variables solves (A + μD)δ = −g, where 2g is the slope of the weighted total F
and 2A its curvature without second derivatives of residuals. D is the largest diagonal of A so far
(Moré 1978), so that units do not matter; μ follows the gain of the last step (Nielsen 1999). A step
is taken where it lowers the total and slopes are finite there: the next one is made of these.
Residuals whose slopes are infinite have no share in A and g, but one in F.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from backends.gauss_newton_products import Products
from backends.raw_parameters import physical_slope, physical_value, raw_value
from compiler.ir.program import Parameter
from msnn.data.dataset import BoolArray, FloatArray, IntArray
from msnn.data.starts import Runs
from msnn.training.engines.engine import EngineState, LossSums, NonFiniteLossError
from msnn.training.engines.quadratic_terms import quadratic_terms
from msnn.training.engines.squares import Squares, loss_sums_of
from msnn.training.plans.epoch_order import shuffled
from msnn.training.plans.stage_plan import StagePlan
from spec_schema.sections.training.optimizers import LevenbergMarquardt

NAME = "levenberg_marquardt"

_MOST_DAMPING = 1e16
"""Times the curvature: a step that is so much shorter is lost in the rounding of the variables."""

_ROUNDED = 1e-9
"""Part by which two sums of the factors of the same rows may differ."""


@dataclass(frozen=True, slots=True)
class _Model:
    """The total near the raw variables: F + 2gᵀδ + δᵀAδ, in variables scaled by 1/√D."""

    total: float
    slope: FloatArray
    curvatures: FloatArray
    """Eigenvalues of A, none below 0."""
    directions: FloatArray
    """Their eigenvectors, in columns."""

    def step(self, damping: float) -> tuple[FloatArray, float]:
        """The scaled step at this damping, and how much the model of the total falls by it."""
        along = -(self.directions.T @ self.slope) / (self.curvatures + damping)
        fall = float(np.sum(along * along * (self.curvatures + 2.0 * damping)))
        return self.directions @ along, fall


class LevenbergMarquardtEngine:
    """Trains the parameters `plan.trained` of one stage; the others keep their values."""

    batches_a_call = 1
    left_out = 0
    has_left_out = False

    def __init__(
        self,
        plan: StagePlan,
        series: Mapping[str, FloatArray],
        weights: Mapping[str, FloatArray],
        train_rows: Mapping[str, BoolArray] | None,
        evaluation_rows: Mapping[str, BoolArray] | None,
        squares: type[Squares],
    ) -> None:
        assert isinstance(plan.optimizer, LevenbergMarquardt)
        self._plan, self._options = plan, plan.optimizer
        self._given = dict(weights)
        program = plan.rollout.program
        self._parameters = [program.parameter(name) for name in plan.trained]
        raws = [raw_value(p, weights[p.name]) for p in self._parameters]
        self.moved = tuple(
            p.name for p, (_, off) in zip(self._parameters, raws, strict=True) if off
        )
        self._raw = np.concatenate([raw.ravel() for raw, _ in raws])
        self._largest = np.zeros_like(self._raw)
        self._damping = self._options.damping
        self._growth = 2.0
        self.finished: str | None = None
        self._ahead: tuple[Runs, Mapping[str, Products]] | None = None
        """The products at the present variables, where the last step has looked at them."""
        self._squares = squares(plan, series, train_rows, evaluation_rows)

    def check(self, runs: Runs) -> None:
        """Compares what was built for this stage with the interpreter. Raises WrongKernelError."""
        self._squares.check(runs, self.weights())

    def weights(self) -> dict[str, FloatArray]:
        """Physical values; parameters that are not trained are exactly those given."""
        return self._weights_at(self._raw)

    def begin_epoch(self, epoch: int, rate: float, attempt: int = 0) -> None:
        """Nothing: it leaves nothing out, as its steps compare totals, and has no rate."""

    def train_batches(
        self,
        runs: Runs,
        size: int,
        members: IntArray | None = None,
        before: LossSums | None = None,
    ) -> LossSums:
        """One step from all rollouts; the losses before it. Raises NonFiniteLossError."""
        assert not before, "an epoch is one step"
        runs = runs if members is None else runs.take(members)
        assert size >= len(runs), "every step takes all rollouts"
        if self.finished is not None:  # with other rollouts it goes on
            self.finished, self._damping, self._growth = None, self._options.damping, 2.0
        in_order = runs.take(np.argsort(runs.t0, kind="stable"))  # so that sums do not shuffle
        products = self._products(in_order)
        if not self._is_finite(products):
            raise NonFiniteLossError(runs, self._without_slopes(products))
        self._note_left_out(products)
        if not self.left_out:
            self._descend(in_order, self._model(products))
        return loss_sums_of(products)

    def order(self, count: int, key: int) -> IntArray:
        """As `epoch_order.shuffled`."""
        return shuffled(count, key)

    def evaluate(self, runs: Runs) -> LossSums:
        """The losses of these rollouts at the current weights, on the rows that count."""
        return self._squares.watched_costs(runs, self.weights())

    def state(self) -> EngineState:
        """Raw variables, scales and damping as they are now."""
        structure = {
            "engine": NAME,
            "damping": self._damping,
            "growth": self._growth,
            "finished": self.finished,
        }
        return EngineState({"raw": self._raw.copy(), "largest": self._largest.copy()}, structure)

    def restore(self, state: EngineState) -> None:
        """Goes back to a state of the same stage; KeyError or ValueError for any other."""
        if not isinstance(state.structure, dict) or state.structure.get("engine") != NAME:
            message = "the checkpoint is of another engine"
            raise ValueError(message)
        self._raw = state.arrays["raw"].copy()
        self._largest = state.arrays["largest"].copy()
        self._damping = float(state.structure["damping"])
        self._growth = float(state.structure["growth"])
        self.finished = state.structure["finished"]
        self._ahead = None

    # ---- one step

    def _products(self, runs: Runs) -> Mapping[str, Products]:
        """The products at the present variables."""
        if self._ahead is not None and _same(self._ahead[0], runs):
            return self._ahead[1]
        return self._squares.products(runs, self.weights())

    def _is_model(self, products: Mapping[str, Products]) -> bool:
        """Whether a next step follows from these."""
        return self._is_finite(products) and not _nothing_left(self._counting(products))

    def _is_finite(self, products: Mapping[str, Products]) -> bool:
        """Whether a step can be made of these; rows of losses that do not count may be anything."""
        return all(
            np.isfinite(one.cost)
            and np.isfinite(one.slope).all()
            and np.isfinite(one.curvature).all()
            for one in self._counting(products)
        )

    def _note_left_out(self, products: Mapping[str, Products]) -> None:
        counting = self._counting(products)
        self.has_left_out = self.has_left_out or any(one.left_out for one in counting)
        self.left_out = int(bool(counting) and _nothing_left(counting))

    def _without_slopes(self, products: Mapping[str, Products]) -> tuple[str, ...]:
        """The parameters in which a loss has no finite slope though its value is one."""
        counting = self._counting(products)
        if not all(np.isfinite(one.cost) for one in counting):
            return ()
        bad = np.zeros(len(self._raw), bool)
        for one in counting:
            bad |= ~np.isfinite(one.slope) | ~np.isfinite(np.diagonal(one.curvature))
        return tuple(p.name for p, part in self._parts(bad) if part.any())

    def _counting(self, products: Mapping[str, Products]) -> list[Products]:
        return [
            products[name]
            for name, weight in self._plan.loss_weights.items()
            if weight and products[name].count
        ]

    def _model(self, products: Mapping[str, Products]) -> _Model:
        # kernels differentiate by physical values; steps are made in raw variables: the chain rule
        physical_by_raw = self._slopes_of_physical()
        slope, curvature = np.zeros_like(self._raw), np.zeros((len(self._raw),) * 2)
        total = 0.0
        for name, weight in self._plan.loss_weights.items():
            found = products[name]
            if weight and found.count:
                share = weight / found.count
                total += share * found.cost
                slope += share * found.slope * physical_by_raw
                curvature += share * found.curvature * np.outer(physical_by_raw, physical_by_raw)
        known = quadratic_terms(self._raw, self._plan.weight_decay)
        total += known.value
        slope += known.slope
        curvature += np.diag(known.curvature)
        # D never shrinks, so that a variable which loses its influence does not run away (Moré
        # 1978)
        self._largest = np.maximum(self._largest, np.diagonal(curvature))
        scale = self._scale()
        # once an epoch: every damping that is tried costs two products with the directions then
        values, vectors = np.linalg.eigh(curvature * np.outer(scale, scale))
        return _Model(total, slope * scale, np.maximum(values, 0.0), vectors)

    def _descend(self, runs: Runs, model: _Model) -> None:
        """Takes the first step that lowers the total, shorter ones until one does."""
        while self._damping < _MOST_DAMPING:
            scaled, fall = model.step(self._damping)
            step = scaled * self._scale()
            # the model promises no more than rounding
            if fall <= np.finfo(float).eps * model.total or not step.any():
                break
            trial = self._raw + step
            # the cost alone first: slopes take as many times longer as there are learned numbers
            total = self._total_at(runs, trial)
            ahead = (
                self._squares.products(runs, self._weights_at(trial))
                if total < model.total
                else None
            )
            if ahead is not None and self._is_model(ahead):
                # 1 where the model was right: the damping falls to a third; Nielsen's rule is
                # smooth between
                gain = (model.total - total) / fall
                self._raw, self._ahead = trial, (runs, ahead)
                self._damping *= max(1.0 / 3.0, 1.0 - (2.0 * gain - 1.0) ** 3)
                self._growth = 2.0
                if max(model.total - total, fall) <= self._options.tolerance * model.total:
                    self.finished = "converged"
                return
            # rejected: doubled, then times 4, 8, …, so that a bad start takes few trials
            self._damping *= self._growth
            self._growth *= 2.0
        else:
            self.finished = "no step lowers the total"
            return
        self.finished = "converged"

    def _total_at(self, runs: Runs, raw: FloatArray) -> float:
        """The weighted total; NaN, which is below nothing, where a rollout leaves the numbers."""
        with np.errstate(over="ignore"):
            weights = self._weights_at(raw)
        sums = self._squares.train_costs(runs, weights)
        losses = sum(
            weight * sums[name].total / sums[name].count
            for name, weight in self._plan.loss_weights.items()
            if weight and sums[name].count
        )
        return losses + quadratic_terms(raw, self._plan.weight_decay).value

    def _scale(self) -> FloatArray:
        """1/√D; 1 in a variable that no residual depends on."""
        return 1.0 / np.sqrt(np.where(self._largest > 0.0, self._largest, 1.0))

    def _weights_at(self, raw: FloatArray) -> dict[str, FloatArray]:
        weights = dict(self._given)
        for parameter, part in self._parts(raw):
            weights[parameter.name] = physical_value(parameter, part)
        return weights

    def _slopes_of_physical(self) -> FloatArray:
        parts = self._parts(self._raw)
        return np.concatenate([physical_slope(p, part).ravel() for p, part in parts])

    def _parts(self, raw: FloatArray) -> list[tuple[Parameter, FloatArray]]:
        shapes = [self._given[p.name].shape for p in self._parameters]
        ends = np.cumsum([int(np.prod(shape)) for shape in shapes])
        parts = np.split(raw, ends[:-1])
        return [
            (parameter, part.reshape(shape))
            for parameter, part, shape in zip(self._parameters, parts, shapes, strict=True)
        ]


def _nothing_left(products: Sequence[Products]) -> bool:
    """Whether the slopes of everything that is scored are infinite."""
    return all(one.left_out >= (1.0 - _ROUNDED) * one.count for one in products)


def _same(one: Runs, other: Runs) -> bool:
    return np.array_equal(one.t0, other.t0) and np.array_equal(one.steps, other.steps)

"""Steps by Levenberg-Marquardt: damped Gauss-Newton on all rollouts of a stage at once.

A step δ of the variables solves (A + μD)δ = −g. F is the weighted total, 2g its gradient and 2A its
Hessian without second derivatives of residuals. Variables are parameters divided by their scale;
for bounded parameters, physical values, which steps keep within the bounds (`damped_steps`). D is
the largest diagonal of A so far (Moré 1978), so that units do not matter. μ follows the gain of the
last step (Nielsen 1999). A step is taken if it lowers the total and all derivatives are finite
after it. Without bounds, the residuals must also still depend on every variable (decision 0460).
Residuals with infinite derivatives are omitted from A and g, but not from F.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from backends.gauss_newton_products import Products
from backends.known_terms import corners
from msnn.data.dataset import BoolArray, FloatArray, IntArray
from msnn.data.rollout_rows import Runs
from msnn.training.engines.engine import EngineState, LossSums, NonFiniteLossError
from msnn.training.engines.second_order.damped_steps import (
    Decay,
    QuadraticTerms,
    VariableBounds,
    in_physical_units,
    quadratic_terms,
)
from msnn.training.engines.second_order.normal_equations import (
    NO_INFLUENCE,
    CountedProducts,
    NormalEquations,
    QuadraticModel,
    counted_products,
    in_raw_variables,
)
from msnn.training.engines.second_order.squares import (
    JointStarts,
    LearnedNumbers,
    Squares,
    loss_sums_of,
)
from msnn.training.plans.loss_terms import known_of
from msnn.training.plans.stage_plan import StagePlan
from msnn.training.plans.stage_result import EstimatedStarts
from spec_schema.sections.optimizers import LevenbergMarquardt

NAME = "levenberg_marquardt in physical units"
"""Name in checkpoints: the variables of bounded parameters are their physical values."""

Weights = Mapping[str, FloatArray]

_MOST_DAMPING = 1e16
"""Maximum damping, relative to the curvature: such short steps vanish in rounding."""

LOST = float(np.finfo(float).eps)
"""Minimum fraction of the curvature of a variable after a step; less is rounding noise."""

_COUNTS = 0.1
"""Fraction of its largest curvature that a variable must have for a step to count as losing it.

A limit that fewer and fewer rows reach may lose its last row.
"""

_LEAST_SHARE = 1e-12
"""Fraction of a bounded variable's largest curvature so far that remains in its damping."""


class LevenbergMarquardtEngine:
    """A second-order engine: each epoch is one Levenberg-Marquardt step on all rollouts.

    It trains the parameters `plan.trained`; the others keep their values. Initial states of
    rollouts can be variables too.
    """

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
        program = plan.rollout.program
        parameters = [program.parameter(name) for name in plan.trained]
        inside = in_physical_units(parameters)
        self._numbers = LearnedNumbers(inside, weights)
        self._raw, self.moved = self._numbers.begin()
        self._learned = len(self._raw)
        self._bounds = VariableBounds.of(parameters)
        self._decay = Decay(plan.weight_decay, parameters)
        self._joint = JointStarts(plan, series) if plan.estimates_starts else None
        self._begun: Weights = {}  # series of the starts with which runs begin
        self._started: Runs | None = None  # whose starts are the last variables, in their order
        self._watches_training = True
        self._known = known_of(plan, inside)
        self._spread = 0.0
        self._largest = np.zeros_like(self._raw)
        self._damping, self._growth = self._options.damping, 2.0
        self.finished: str | None = None
        self._ahead: tuple[Runs, Mapping[str, Products]] | None = None
        """The products at the current variables, if the last step computed them."""
        as_squares = plan if self._joint is None else self._joint.plan
        self._squares = squares(as_squares, series, train_rows, evaluation_rows)

    def check(self, runs: Runs) -> None:
        """Compares the kernels with the reference interpreter.

        Raises WrongKernelError if they differ.
        """
        self._squares.check(runs, self._all(self.weights()))

    def weights(self) -> dict[str, FloatArray]:
        """Physical values; untrained parameters keep exactly their given values."""
        return self._numbers.weights(self._raw)

    def starts(self) -> EstimatedStarts | None:
        """The initial states of the last training runs; None if they are not estimated."""
        if self._joint is None or self._started is None:
            return None
        runs = self._started
        values = self._joint.values(self._raw[self._learned :].copy(), len(runs))
        return EstimatedStarts(t0=runs.t0, steps=runs.steps, values=values)

    def begin_epoch(self, epoch: int, rate: float, attempt: int = 0, spread: float = 0.0) -> None:
        """Sets the weight of priors. Dropout is not used, because steps compare totals."""
        self._spread = spread

    def measure(self, runs: Runs) -> LossSums:
        """The losses of training rollouts at the current weights."""
        in_order = runs.take(np.argsort(runs.t0, kind="stable"))
        self._begin(in_order)
        return self._costs_at(in_order, self._raw)

    def write(self, series: Weights, *, watched: bool) -> None:
        """Overwrites the series of initial states; estimated ones then begin with these values."""
        if watched:
            self._watches_training = False
        else:
            self._begun, self._ahead = series, None
        if watched or self._joint is None:
            self._squares.write(series, watched=watched)

    def train_batches(
        self,
        runs: Runs,
        size: int,
        members: IntArray | None = None,
        before: LossSums | None = None,
    ) -> LossSums:
        """Takes one step on all rollouts, or on those in `members`; returns the losses before it.

        An epoch is one step: `size` is at least the number of rollouts, and `before` is empty.
        Raises NonFiniteLossError if a loss, its gradient or its curvature is infinite or NaN.
        """
        assert not before, "an epoch is one step"
        runs = runs if members is None else runs.take(members)
        assert size >= len(runs), "every step takes all rollouts"
        if self.finished is not None:  # with other rollouts it goes on
            self.finished, self._damping, self._growth = None, self._options.damping, 2.0
        in_order = runs.take(np.argsort(runs.t0, kind="stable"))  # so that sums do not shuffle
        self._begin(in_order)
        products = self._products(in_order)
        counted = self._counted(products)
        if not counted.are_finite:
            raise NonFiniteLossError(runs, counted.without_slopes(self._numbers))
        self.has_left_out = self.has_left_out or counted.leave_out_some
        self.left_out = int(counted.leave_out_all)
        if self._joint is not None and not counted.by_loss:
            self.finished = "nothing is scored"  # nor does anything decide where runs start
        elif not self.left_out:
            self._descend(in_order, self._equations(products))
        return loss_sums_of(products)

    def order(self, count: int, key: int) -> IntArray:
        """The natural order: every step uses all rollouts, in the order of their rows."""
        del key
        return np.arange(count, dtype=np.int64)

    def evaluate(self, runs: Runs) -> LossSums:
        """The losses of these rollouts at the current weights, on the rows of the monitor's set."""
        if self._joint is not None and self._watches_training:
            trained = (self._raw, self._largest, self._started, self._ahead)
            found = self.measure(runs)
            # a curriculum trains other rollouts: their initial states remain the variables
            if trained[2] is not None:
                self._raw, self._largest, self._started, self._ahead = trained
            return found
        return self._squares.watched_costs(runs, self._all(self.weights()))

    def state(self) -> EngineState:
        """A copy of the raw variables, their scales and the damping, for a checkpoint."""
        structure = {
            "engine": NAME,
            "damping": self._damping,
            "growth": self._growth,
            "finished": self.finished,
        }
        arrays = {"raw": self._raw.copy(), "largest": self._largest.copy()}
        arrays["contacts"] = self._bounds.contacts.copy()
        if self._started is not None:
            # arrays of a state are of floats, which have every row number below 2⁵³ exactly
            arrays |= {n: getattr(self._started, n).astype(float) for n in ("t0", "steps")}
        return EngineState(arrays, structure)

    def restore(self, state: EngineState) -> None:
        """Restores a state of the same stage; KeyError or ValueError for any other."""
        if not isinstance(state.structure, dict) or state.structure.get("engine") != NAME:
            message = "the checkpoint is of another engine"
            raise ValueError(message)
        self._raw = state.arrays["raw"].copy()
        self._largest = state.arrays["largest"].copy()
        self._bounds = replace(self._bounds, contacts=state.arrays["contacts"].copy())
        self._damping = float(state.structure["damping"])
        self._growth = float(state.structure["growth"])
        self.finished = state.structure["finished"]
        self._ahead = None
        if "t0" in state.arrays:
            t0, steps = (state.arrays[name].astype(np.int64) for name in ("t0", "steps"))
            self._started = Runs(t0, steps, 0, 0)

    def _begin(self, runs: Runs) -> None:
        """Makes the initial states of these runs the variables, if the runs have changed."""
        if self._joint is None or (self._started is not None and self._started.begin_as(runs)):
            return
        n, starts = self._learned, self._joint.flat(self._begun, runs.t0)
        if self._started is not None:
            # other runs: those that begin in the same rows begin where they were
            _, here, before = np.intersect1d(runs.t0, self._started.t0, return_indices=True)
            known = self._raw[n:].reshape(len(self._started), -1)
            starts.reshape(len(runs), -1)[here] = known[before]
        self._raw = np.append(self._raw[:n], starts)
        self._largest = np.append(self._largest[:n], np.zeros_like(starts))
        self._started, self._ahead = runs, None

    def _all(self, weights: Weights) -> Weights:
        """The weights with the additional parameters for initial states, if these are variables."""
        return weights if self._joint is None else self._joint.moved(weights)

    def _products_at(self, runs: Runs, raw: FloatArray) -> Mapping[str, Products]:
        weights = self._numbers.weights(raw)
        if self._joint is None:
            return self._squares.products(runs, weights)
        self._write_starts(runs, raw)
        return self._joint.products(self._squares, runs, weights)

    def _costs_at(self, runs: Runs, raw: FloatArray) -> LossSums:
        self._write_starts(runs, raw)
        return self._squares.train_costs(runs, self._all(self._numbers.weights(raw)))

    def _write_starts(self, runs: Runs, raw: FloatArray) -> None:
        if self._joint is not None:
            series = self._joint.series(raw[self._learned :], runs.t0)
            self._squares.write(series, watched=False)

    def _products(self, runs: Runs) -> Mapping[str, Products]:
        """JᵀJ and Jᵀr of every loss at the current variables; reused if the last step computed
        them.
        """
        if self._ahead is not None and self._ahead[0].begin_as(runs):
            return self._ahead[1]
        return self._products_at(runs, self._raw)

    def _counted(self, products: Mapping[str, Products]) -> CountedProducts:
        return counted_products(self._plan, products)

    def _equations(
        self, products: Mapping[str, Products], at: FloatArray | None = None
    ) -> NormalEquations:
        """F, its gradient and its curvature at the current variables or at `at`."""
        whole = self._raw if at is None else at
        shares = {
            name: self._plan.loss_weights[name] / found.count
            for name, found in self._counted(products).by_loss.items()
        }
        losses = in_raw_variables(products, shares, self._numbers.slopes(whole))
        raw = whole[: self._learned]
        return losses.plus(self._quadratic_terms(raw), corners(self._known, raw))

    def _model(self, found: NormalEquations) -> QuadraticModel:
        """The quadratic model for the next step, in variables scaled by D, the largest curvature so
        far.
        """
        # D never shrinks, so that a variable which loses its influence does not run away (Moré
        # 1978); bounds keep it from that, and within them the present size reaches more minima
        self._largest = np.maximum(self._largest, found.diagonal)
        least = _LEAST_SHARE if self._bounds.some else 1.0
        return self._scaled_by(found, np.maximum(found.diagonal, least * self._largest))

    def _scaled_by(self, found: NormalEquations, size: FloatArray) -> QuadraticModel:
        """The quadratic model in variables times √size; factor 1 for a variable without
        influence.
        """
        scale = 1.0 / np.sqrt(np.where(size > NO_INFLUENCE, size, 1.0))
        return found.model(scale, self._raw[: self._learned], self._known, self._bounds)

    def _quadratic_terms(self, raw: FloatArray) -> QuadraticTerms:
        return quadratic_terms(self._known, raw, self._decay, self._spread)

    def _descend(self, runs: Runs, equations: NormalEquations) -> None:
        """Takes the first step that lowers the total, increasing the damping until one does."""
        model = self._model(equations)
        n = self._learned
        lost: tuple[FloatArray, Mapping[str, Products]] | None = None
        while self._damping < _MOST_DAMPING:
            step, fall = model.step(self._damping)
            # the model promises no more than rounding
            if fall <= np.finfo(float).eps * model.total or not step.any():
                if not self._forgets_largest(equations):
                    break
                model = self._model(equations)
                continue
            trial = self._raw + step
            trial[:n] = self._bounds.moved(self._raw[:n], step[:n])
            # the cost alone first: slopes take as many times longer as there are learned numbers
            total = self._total_at(runs, trial)
            ahead = self._products_at(runs, trial) if total < model.total else None
            goes_on = ahead is not None and self._counted(ahead).make_a_model
            if ahead is not None and goes_on and self._loses(equations, ahead, trial):
                lost, goes_on = (trial, ahead) if lost is None else lost, False
            if ahead is not None and goes_on:
                # 1 where the model was right: the damping falls to a third; Nielsen's rule is
                # smooth between
                gain = (model.total - total) / fall
                self._bounds = self._bounds.met(self._raw[:n], trial[:n])
                self._raw, self._ahead = trial, (runs, ahead)
                self._damping *= max(1.0 / 3.0, 1.0 - (2.0 * gain - 1.0) ** 3)
                self._growth = 2.0
                # both small: a fall that the model did not foresee is no convergence
                small = max(model.total - total, fall) <= self._options.tolerance * model.total
                if small and self._is_stationary(self._equations(ahead)):
                    self._end_on_bounds(runs, self._equations(ahead))
                return
            # rejected: doubled, then times 4, 8, …, so that a bad start takes few trials
            self._damping *= self._growth
            self._growth *= 2.0
        # the model sees nothing more to gain, or the damping has come to its end
        if self._is_stationary(equations):
            self._end_on_bounds(runs, equations)
        elif lost is not None:
            # a limit that no row reaches at the minimum rightly counts for nothing there
            self._raw, self._ahead = lost[0], (runs, lost[1])
            self._damping, self._growth = self._options.damping, 2.0
        else:
            self.finished = "no step lowers the total"

    def _forgets_largest(self, equations: NormalEquations) -> bool:
        """True if old curvatures blocked the variables; damping then restarts without them.

        A variable whose curvature was 10¹⁰ times larger at a bad initial point is damped by that
        value. It would not move for any damping at which the others move. Happens at most once per
        step.
        """
        present = equations.diagonal
        if self._bounds.some or np.all(self._largest <= present):
            return False
        if self._is_stationary(equations):
            return False
        self._largest = present.copy()
        self._damping, self._growth = self._options.damping, 2.0
        return True

    def _loses(
        self, here: NormalEquations, ahead: Mapping[str, Products], trial: FloatArray
    ) -> bool:
        """True if at the trial point the residuals no longer depend on a variable.

        For example, no derivative leads back from a region where an exponential is 0. Such a step
        is rejected unless no shorter step lowers the total. Kinks of penalties and bounds are
        exempt: there a variable may correctly have no influence.
        """
        if self._known.has_corners or self._bounds.some:
            return False
        seen, left = here.diagonal, self._equations(ahead, trial).diagonal
        counted = (seen > NO_INFLUENCE) & (seen > _COUNTS * self._largest)
        return bool(np.any(counted & (left < LOST * seen)))

    def _end_on_bounds(self, runs: Runs, equations: NormalEquations) -> None:
        """Ends at a minimum, with values exactly on the bounds that they were approaching."""
        self.finished = "converged"
        n = self._learned
        trial = self._raw.copy()
        trial[:n] = equations.onto_bounds(trial[:n], self._bounds)
        if np.any(trial != self._raw) and self._total_at(runs, trial) <= equations.total:
            self._raw, self._ahead = trial, None

    def _is_stationary(self, found: NormalEquations) -> bool:
        """True if the derivative of the total vanishes in all feasible directions.

        This must be checked: far from a minimum, a large damping also makes steps short.
        """
        raw = self._raw[: self._learned]
        if found.is_stationary(raw, self._known, self._bounds):
            return True
        # in the present sizes: a larger D damps even by little
        undamped = self._scaled_by(found, found.diagonal)
        return undamped.promise() <= self._options.tolerance * found.total

    def _total_at(self, runs: Runs, raw: FloatArray) -> float:
        """The weighted total; NaN, which compares as not lower, if a rollout is not finite."""
        with np.errstate(over="ignore"):
            sums = self._costs_at(runs, raw)
        losses = sum(
            weight * sums[name].total / sums[name].count
            for name, weight in self._plan.loss_weights.items()
            if weight and sums[name].count
        )
        return losses + self._quadratic_terms(raw[: self._learned]).value

"""Estimates how well the data determine the learned parameters, when a training ends.

Near the minimum of the total F = Σ cₗ rₗᵀrₗ the estimate is linear in the noise of the residuals:
cov θ = H⁻¹ (Σ cₗ² σₗ² JₗᵀJₗ) H⁻¹ with H = Σ cₗ JₗᵀJₗ and σₗ² = rₗᵀrₗ / (nₗ − pₗ), where
pₗ = tr(H⁻¹ cₗ JₗᵀJₗ) are the parameters that loss l determines. With one loss this is
σ²(JᵀJ)⁻¹, σ² = rᵀr / (n − p) (Ljung, System Identification, 1999, ch. 9). A prior is one more
residual, (p − mean)/std of variance 1 with c = ŝ²/n, which makes it the posterior covariance.
Numbers that a penalty holds at 0 have no errors, nor have those at bounds. The residuals are taken
as white: rows that are correlated say less than they seem to, and the errors come out too small.
Where a row has a factor w, r and J are √w times what they are, as if its noise were σ/√w; n counts
every row with w > 0 once. Starts that were estimated with the parameters are eliminated from H and
JₗᵀJₗ first, and count among the pₗ.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from backends.files.c_compiler import CompilerMissingError
from backends.gauss_newton_products import Products
from backends.known_terms import KnownTerms, in_corners
from compiler.ir.program import Measure, Parameter
from msnn.data.dataset import Dataset, FloatArray, IntArray
from msnn.data.starts import Runs
from msnn.model.weights.covariance_file import Covariance
from msnn.simulation.rollout import LossSum
from msnn.simulation.rollout_plan import counted_rows, set_rollouts
from msnn.simulation.start_fit import StartFit
from msnn.training.engines.native.kernel_or_not import try_natively
from msnn.training.engines.native.native_slopes import NativeSlopes
from msnn.training.engines.second_order.joint_starts import JointStarts, without_starts
from msnn.training.engines.second_order.squares import Slopes
from msnn.training.plans.known_terms_of_stage import known_of, square_by_count
from msnn.training.plans.squared_losses import NUMBER_OF, squared
from msnn.training.plans.stage_data import TRAIN
from msnn.training.plans.stage_plan import StagePlan
from msnn.training.records.learned.identified import (
    combinations,
    inverted,
    is_part_of,
    number_names,
)
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings

MOST_NUMBERS = 300
"""Learned numbers up to which standard errors are computed: the effort grows with their square."""

MOST_SLOPES = 300_000
"""Learned numbers times operations of a step up to which they are computed.

Every operation has a slope in every number. 240,000, an arm of six joints with 73 numbers, take gcc
5 to 6 s and the kernel as long.
"""

AT_BOUND = 1e-3
"""Part of the range within which a value counts as at its bound."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StandardErrors:
    """Standard errors in the units of the parameters; NaN for a number that has none."""

    errors: Mapping[str, FloatArray]
    """Of the parameters that the last stage trained."""
    unidentified: tuple[Mapping[str, float], ...]
    """Changes of numbers, by name, that leave every residual as it is; the largest is 1."""
    noise: Mapping[str, float]
    """σ of each loss's residuals."""
    residuals: int
    reason: str | None = None
    """Why there are none at all."""
    notes: tuple[Diagnostic, ...] = ()
    """Why they were not computed by kernels."""
    covariance: Covariance | None = None
    """What the errors are the roots of the diagonal of; None where there is none at all."""


def standard_errors(
    plan: StagePlan, data: Dataset, weights: Mapping[str, FloatArray]
) -> StandardErrors:
    """The standard errors of the parameters that a stage trained, from its train rows.

    Rollouts are those of the stage, a horizon apart, so that each row counts once. `huber` and
    `rmse` count as mse; losses that are no sums of squares are left out.
    """
    program = squared(plan.rollout.program, plan.loss_weights)
    parameters = [program.parameter(name) for name in plan.trained]
    numbers = sum(weights[p.name].size for p in parameters)
    if not any(loss.target is not None for loss in program.losses):
        return without_errors("no loss is a sum of squares")
    if numbers > MOST_NUMBERS:
        return without_errors(f"more than {MOST_NUMBERS} numbers are learned")
    operations = len(program.step)
    if numbers * operations > MOST_SLOPES:
        return without_errors(
            f"slopes of {operations} operations in {numbers} numbers are more than {MOST_SLOPES}"
        )
    starts = plan.rollout.starts
    if starts is not None:
        starts = replace(starts, program=squared(starts.program, plan.loss_weights))
    rollout = replace(plan.rollout, program=program, starts=starts)
    runs = set_rollouts(rollout, data, TRAIN, None, "standard errors", plan.span, Findings())
    if runs is None:
        return without_errors("no rollout fits the data")
    rows = counted_rows(rollout, data, TRAIN)
    plan = replace(plan, rollout=rollout)
    products, notes = _products(plan, data, rows, runs, weights)
    return replace(_estimated(plan, parameters, weights, *products), notes=notes)


def at_bound(parameter: Parameter, value: FloatArray) -> np.ndarray:
    """Which elements of a value are at a bound of the parameter."""
    low, high = parameter.minimum, parameter.maximum
    # with one bound there is no range: the parameter's scale is what a change is measured by
    span = high - low if low is not None and high is not None else abs(parameter.scale)
    found = np.zeros(value.shape, dtype=np.bool_)
    if low is not None:
        found |= value - low < AT_BOUND * span
    if high is not None:
        found |= high - value < AT_BOUND * span
    return found


def without_errors(reason: str) -> StandardErrors:
    """None, and why."""
    return StandardErrors(errors={}, unidentified=(), noise={}, residuals=0, reason=reason)


def _numbers(products: Mapping[str, Products], name: str) -> float:
    """Residuals of a loss that have a share in its products."""
    one = products[name]
    counted = products.get(f"{NUMBER_OF}{name}")
    number = one.count if counted is None else counted.cost
    return number * (1.0 - one.left_out / one.count)


def _products(
    plan: StagePlan,
    data: Dataset,
    rows: Mapping[str, np.ndarray] | None,
    runs: Runs,
    weights: Mapping[str, FloatArray],
) -> tuple[tuple[Mapping[str, Products], Mapping[str, float]], tuple[Diagnostic, ...]]:
    """The products of every loss, and how many of its residuals starts have used up.

    Starts that were found before the training are given; those estimated with it are found again at
    its end, from all that is scored, where the total is lowest in them too.
    """
    starts = plan.rollout.starts
    if starts is None:
        squares, notes = _squares(plan, data, rows, runs, weights)
        return (squares.products(runs, weights), {}), notes
    joint = plan.estimates_starts
    fit = StartFit(starts.program, None if joint else starts.over, starts.skip if joint else 0)
    found = fit.find(data.series, runs, weights, plan.loss_weights, rows if joint else None)
    unknown = JointStarts(plan, data.series)
    as_squares = unknown.plan if joint else plan
    moved = unknown.moved(weights) if joint else weights
    squares, notes = _squares(as_squares, data, rows, runs, moved)
    squares.write(found.series(data.rows), watched=False)
    if not joint:
        return (squares.products(runs, weights), {}), notes
    products = unknown.products(squares, runs, weights)
    return without_starts(products, _shares(plan, products)), notes


def _squares(
    plan: StagePlan,
    data: Dataset,
    rows: Mapping[str, np.ndarray] | None,
    runs: Runs,
    weights: Mapping[str, FloatArray],
) -> tuple[Slopes, tuple[Diagnostic, ...]]:
    """By kernels where there can be any, else by torch with what the user should know."""

    def native(_: StagePlan) -> NativeSlopes:
        squares = NativeSlopes(plan, data.series, rows)
        squares.check(runs, weights)
        return squares

    notes: tuple[Diagnostic, ...] = ()
    if plan.engine != "torch":
        try:
            # what is trained is not refused now, even where kernels were asked for
            tried = try_natively(replace(plan, engine="auto"), native, in_double=False)
            if tried.made is not None:
                return tried.made, tried.notes
            notes = tried.notes
        except CompilerMissingError:
            pass
    # torch takes seconds to import: only where it computes
    from msnn.training.engines.torch.torch_squares import TorchSquares

    return TorchSquares(plan, data.series, rows, rows), notes


def _estimated(
    plan: StagePlan,
    parameters: list[Parameter],
    weights: Mapping[str, FloatArray],
    products: Mapping[str, Products],
    used_up: Mapping[str, float],
) -> StandardErrors:
    known = known_of(plan, parameters)
    held = np.concatenate([at_bound(p, weights[p.name]).ravel() for p in parameters])
    held |= in_corners(known, np.concatenate([weights[p.name].ravel() for p in parameters]))
    # a number at its bound cannot move both ways: it counts as known, and has no error
    free = np.flatnonzero(~held)
    names = [n for p in parameters for n in number_names(p.name, weights[p.name].shape)]
    shares = _shares(plan, products)
    curvatures = {
        name: share * products[name].curvature[np.ix_(free, free)] for name, share in shares.items()
    }
    prior = _prior_curvature(plan, known, products)[free]
    total = sum(curvatures.values(), np.diag(prior[:, 0]))
    inverse, nothing = inverted(total)
    # the residuals of a penalty such as l2(w) are no measurements: it has no noise
    measured = {loss.name for loss in plan.rollout.program.losses if loss.target is not None}
    noise: dict[str, float] = {}
    # the deviation from a prior is one more residual, whose variance is known: 1
    spread = np.diag(prior[:, 1])
    for name in measured & curvatures.keys():
        one, curvature = products[name], curvatures[name]
        freedom = _numbers(products, name) - float(np.sum(inverse * curvature))
        # each estimated start has explained as many residuals as it has numbers
        freedom -= used_up.get(name, 0.0)
        variance = one.squares / freedom if freedom > 0 else np.nan
        noise[name] = float(np.sqrt(variance))
        spread += shares[name] * variance * curvature
    variances = np.full(len(held), np.nan)
    # the sandwich H⁻¹ S H⁻¹: losses with other noise than their weights say are told right too
    covariance = inverse @ spread @ inverse
    variances[free] = np.diagonal(covariance)
    # the inverse leaves unidentified directions out, which would make them look certain
    variances[free[is_part_of(nothing)]] = np.nan
    sizes = np.cumsum([weights[p.name].size for p in parameters])[:-1]
    errors = np.split(np.sqrt(variances), sizes)
    return StandardErrors(
        errors={
            p.name: e.reshape(weights[p.name].shape)
            for p, e in zip(parameters, errors, strict=True)
        },
        unidentified=combinations(total, nothing, [names[i] for i in free]),
        noise=noise,
        residuals=round(sum(_numbers(products, name) for name in noise)),
        covariance=_kept(parameters, weights, free, covariance),
    )


def _kept(
    parameters: Sequence[Parameter],
    weights: Mapping[str, FloatArray],
    free: IntArray,
    covariance: FloatArray,
) -> Covariance | None:
    """That of all numbers, those that are held included; None where residuals are too few."""
    if not np.all(np.isfinite(covariance)):
        return None
    names = [parameter.name for parameter in parameters]
    whole = np.zeros((sum(weights[name].size for name in names),) * 2)
    whole[np.ix_(free, free)] = covariance
    return Covariance.sorted_by_name(names, weights, whole)


def _shares(plan: StagePlan, products: Mapping[str, Products]) -> dict[str, float]:
    """Of the losses that score something."""
    names = [name for name in plan.loss_weights if name in products and products[name].count]
    return {name: _share(plan, name, products[name]) for name in names}


def _prior_curvature(
    plan: StagePlan, known: KnownTerms, products: Mapping[str, Products]
) -> FloatArray:
    """What the prior of each number adds to H, and to the variance of the slope."""
    residuals = [one for one in products.values() if one.count]
    sums = {name: LossSum(one.cost, one.count) for name, one in products.items()}
    weight = square_by_count(plan, sums) if residuals else 0.0
    slope = np.where(known.std > 0, 1.0 / np.where(known.std > 0, known.std, 1.0), 0.0)
    return np.stack([weight * slope**2, (weight * slope) ** 2], axis=1)


def _share(plan: StagePlan, name: str, found: Products) -> float:
    """How much a squared residual adds to the total; near the minimum for a root."""
    loss = next(loss for loss in plan.rollout.program.losses if loss.name == name)
    share = plan.loss_weights[loss.name] / found.count
    if loss.measure is Measure.RMSE and found.cost > 0:
        return share / (2.0 * float(np.sqrt(found.cost / found.count)))
    return share

"""Estimates standard errors of the learned parameters at the end of a training.

Near the minimum of the total F = Σ cₗ rₗᵀrₗ the estimate is linear in the noise of the residuals.
Then cov θ = H⁻¹ (Σ cₗ² σₗ² JₗᵀJₗ) H⁻¹ with H = Σ cₗ JₗᵀJₗ and σₗ² = rₗᵀrₗ / (nₗ − pₗ). Loss l
determines pₗ = tr(H⁻¹ cₗ JₗᵀJₗ) of the parameters. With one loss this is σ²(JᵀJ)⁻¹, σ² = rᵀr / (n −
p) (Ljung, System Identification, 1999, ch. 9).

A prior is an additional residual, (p − mean)/std of variance 1 with c = ŝ²/n, so the result is the
posterior covariance. Penalties `l2` and weight decay λ/2 Σ raw² contribute to H, but no noise. The
errors are then those of the regularised estimate and exclude its bias (Hoerl, Kennard 1970).
Decoupled decay, as in adamw, contributes nothing: see `StagePlan.decay_of_total`. Elements at
bounds, and zeros due to a penalty, have no standard errors.

Residuals are assumed to be white. Autocorrelated rows contain less information, and the errors are
then too small. If a row has a factor w, r and J are multiplied by √w, as if its noise were σ/√w; n
counts every row with w > 0 once. Initial states estimated with the parameters are first eliminated
from H and JₗᵀJₗ, and count in pₗ. For those estimated separately see `held_starts`.

For `huber`, H is c/2 Σ ψ' jjᵀ and the middle (c/2)² Σ ψ² jjᵀ · n/(n − p). Here ψ is the clipped
residual and j its derivative (`squared_losses`); the noise may be heteroscedastic (Huber 1967,
White 1980). Initial states estimated with the parameters of a `huber` follow them by its H.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from backends.gauss_newton_products import Products
from backends.known_terms import KnownTerms, in_corners
from compiler.differentiation.sums_of_squares import is_sum_of_squares
from compiler.ir.program import Measure, Parameter
from msnn.data.dataset import Dataset, FloatArray, IntArray
from msnn.model.weights.covariance import Covariance
from msnn.simulation.rollout import LossSum
from msnn.simulation.rollout_plan import counted_rows, set_rollouts
from msnn.training.engines.second_order.damped_steps import (
    Decay,
    in_physical_units,
    quadratic_terms,
)
from msnn.training.plans.loss_terms import is_all_squared, known_of, square_by_count, squared
from msnn.training.plans.stage_checks import concerns
from msnn.training.plans.stage_data import TRAIN
from msnn.training.plans.stage_plan import StagePlan
from msnn.training.plans.stage_result import EstimatedStarts
from msnn.training.records.learned.beside_bounds import (
    BesideBounds,
    beside_bounds,
    is_near_bound,
)
from msnn.training.records.learned.information import (
    Information,
    combinations,
    inverted,
    is_part_of,
    number_names,
    numbers,
    shares_of,
)
from msnn.training.records.learned.information_of_stage import information_of, trained_runs
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings

MOST_NUMBERS = 300
"""Maximum number of learned elements for standard errors; the effort grows quadratically."""

MOST_SLOPES = 300_000
"""Maximum of learned elements times operations of a step for standard errors.

Every operation has a derivative with respect to every element. With 240,000 (an arm of six joints
with 73 elements), gcc takes 5 to 6 s and the kernel as long.
"""

_WITHIN = 10
"""Minimum number of residuals within δ, beyond two per learned element, for `huber`.

With this minimum, 89 to 93 % of the 95 % intervals contain the true value, with half of it 77 %.
Measured for a line through rows with heavy tails (Student's t, 2.5 degrees of freedom).
"""


_GAIN = 0.1
"""Relative decrease of the total that a stage must still reach to count as unfinished.

Steps with a fixed rate end near the minimum, at a distance of about their length.
"""
_FLAT = 1e-9
"""Eigenvalue of the scaled curvature, relative to the largest, below which a direction is flat."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StandardErrors:
    """Standard errors in the units of the parameters; NaN for an element without one."""

    errors: Mapping[str, FloatArray]
    """Errors of the parameters that the last stage trained."""
    unidentified: tuple[Mapping[str, float], ...]
    """Changes of elements, by name, that leave all residuals unchanged; the largest change is 1."""
    noise: Mapping[str, float]
    """σ of each loss's residuals."""
    residuals: int
    reason: str | None = None
    """The reason if there are no standard errors at all."""
    notes: tuple[Diagnostic, ...] = ()
    """Notes on why kernels were not used."""
    covariance: Covariance | None = None
    """The covariance matrix of all elements; None if there are no standard errors."""
    beside: BesideBounds | None = None
    """The values at bounds; None if the derivative of the total is unknown."""


def standard_errors(
    plan: StagePlan,
    data: Dataset,
    weights: Mapping[str, FloatArray],
    estimated: EstimatedStarts | None = None,
) -> StandardErrors:
    """The standard errors of the parameters that a stage trained, from its training rows.

    `estimated` are the final initial states, if training estimated them. `huber` needs them:
    estimated again, they would minimise squares instead of the total.

    Rollouts are those of the stage, one horizon apart, so that each row counts once. `rmse` counts
    as mse with its weight near the minimum. A loss with unknown curvature (`mae`, a cost that is
    not a square) rules out standard errors, because the parameters minimise that loss too.
    """
    found = _at_the_end(plan, data, weights, estimated)
    if isinstance(found, str):
        return without_errors(found)
    errors = _estimated(found, weights)
    return replace(errors, notes=found.notes)


def ways_left(
    plan: StagePlan,
    data: Dataset,
    weights: Mapping[str, FloatArray],
    estimated: EstimatedStarts | None = None,
) -> Mapping[str, FloatArray] | None:
    """The estimated distance of each trained element from its value at the minimum of the total.

    It is the Gauss-Newton step −A⁻¹g for all elements, without unidentifiable directions; 0 if this
    step lowers the total by less than a tenth. None if the curvature is unknown.
    """
    found = _at_the_end(plan, data, weights, estimated)
    if isinstance(found, str):
        return None
    slope, curvature, total = _derivatives(found, weights)
    bent = np.diagonal(curvature)
    size = np.sqrt(np.where(bent > 0.0, bent, np.inf))
    scaled = np.where(np.isfinite(size), curvature / np.outer(size, size), 0.0)
    way = -(np.linalg.pinv(scaled, rcond=_FLAT, hermitian=True) @ (slope / size)) / size
    if not -slope @ way > _GAIN * total:
        way = np.zeros_like(way)
    sizes = np.cumsum([weights[p.name].size for p in found.parameters])[:-1]
    return {
        p.name: part.reshape(weights[p.name].shape)
        for p, part in zip(found.parameters, np.split(way, sizes), strict=True)
    }


@dataclass(frozen=True, slots=True, kw_only=True)
class _End:
    """The derivatives of a stage's residuals at its final weights, from which standard errors
    follow.
    """

    plan: StagePlan
    parameters: list[Parameter]
    said: Information
    products: Mapping[str, Products]
    notes: tuple[Diagnostic, ...]
    is_whole: bool
    """True if all weighted losses are sums of squares."""


def _at_the_end(
    plan: StagePlan,
    data: Dataset,
    weights: Mapping[str, FloatArray],
    estimated: EstimatedStarts | None,
) -> _End | str:
    """The sums over all rollouts, or a text with the reason why there are none."""
    unknown = _unknown_curvature(plan)
    if unknown is not None:
        return unknown
    is_whole = is_all_squared(plan.rollout.program, plan.loss_weights)
    program = squared(plan.rollout.program, plan.loss_weights, robust=True)
    parameters = [program.parameter(name) for name in plan.trained]
    learned = sum(weights[p.name].size for p in parameters)
    if not any(loss.target is not None for loss in program.losses):
        return "no loss is a sum of squares"
    if learned > MOST_NUMBERS:
        return f"more than {MOST_NUMBERS} numbers are learned"
    operations = len(program.step)
    if learned * operations > MOST_SLOPES:
        return f"slopes of {operations} operations in {learned} numbers are more than {MOST_SLOPES}"
    starts = plan.rollout.starts
    robust = [loss.name for loss in program.losses if loss.measure is Measure.HUBER]
    if starts is not None:
        as_squares = squared(starts.program, plan.loss_weights, robust=bool(robust))
        starts = replace(starts, program=as_squares)
        if robust and not plan.estimates_starts:
            return (
                f"`{robust[0]}` is huber, and its starts minimise squares; `levenberg_marquardt` "
                "estimates them together with the parameters"
            )
    rollout = replace(plan.rollout, program=program, starts=starts)
    runs = set_rollouts(rollout, data, TRAIN, None, "standard errors", plan.span, Findings())
    if runs is None:
        return "no rollout fits the data"
    rows = counted_rows(rollout, data, TRAIN)
    plan = replace(plan, rollout=rollout)
    trained = None
    if robust and starts is not None:
        found = trained_runs(runs, estimated)
        if found is None:
            return f"the starts that `{robust[0]}`, a huber, ended with are unknown"
        runs, trained = found
    said, products, notes = information_of(plan, data, rows, runs, weights, trained)
    return _End(
        plan=plan,
        parameters=parameters,
        said=said,
        products=products,
        notes=notes,
        is_whole=is_whole,
    )


def _unknown_curvature(plan: StagePlan) -> str | None:
    """The reason why the curvature of the total is unknown; None if it is known."""
    for loss in plan.program.losses:
        # a penalty is straight beside its corner
        known = loss.measure is Measure.RMSE or is_sum_of_squares(plan.program.step, loss)
        if known or loss.penalty is not None or not plan.loss_weights[loss.name]:
            continue
        alone = {one.name: float(one is loss) for one in plan.program.losses}
        if not concerns(plan.program, alone, plan.trained):
            continue
        if loss.measure is Measure.MAE:
            return (
                f"those of `{loss.name}`, a mae, depend on the density of its noise at 0; "
                "`huber(…, delta=…)` has them"
            )
        return f"`{loss.name}` is no sum of squares"
    return None


def without_errors(reason: str) -> StandardErrors:
    """An empty result with its reason."""
    return StandardErrors(errors={}, unidentified=(), noise={}, residuals=0, reason=reason)


def _estimated(end: _End, weights: Mapping[str, FloatArray]) -> StandardErrors:
    plan, parameters, said, products = end.plan, end.parameters, end.said, end.products
    known = known_of(plan, parameters)
    beside = _beside(end, weights) if end.is_whole else None
    held = np.concatenate(
        [
            (is_near_bound(p, weights[p.name]) if beside is None else beside.held[p.name]).ravel()
            for p in parameters
        ]
    )
    held |= in_corners(known, np.concatenate([weights[p.name].ravel() for p in parameters]))
    # a number at its bound cannot move both ways: it counts as known, and has no error
    free = np.flatnonzero(~held)
    names = [n for p in parameters for n in number_names(p.name, weights[p.name].shape)]
    said = said.of(free)
    for name, one in said.robust.items():
        learned = len(free) + round(said.used_up.get(name, 0.0))
        if one.within < _WITHIN + 2 * learned:
            return without_errors(
                f"only {one.within:.0f} of {numbers(products, name):.0f} residuals of `{name}` are "
                f"within its delta, too few for {learned} learned numbers"
            )
    beyond = np.diag(_beside_data(end, weights)[1][free])
    total, equations = said.curvature() + beyond, said.equations()
    if equations is not None:
        equations = equations + beyond
    try:
        inverse, nothing = inverted(total, equations)
    except np.linalg.LinAlgError:
        found = "residuals within delta" if said.robust else "the scored residuals"
        return without_errors(f"{found} do not determine the learned numbers")
    # the residuals of a penalty such as l2(w) are no measurements: it has no noise
    targets = (loss.name for loss in plan.rollout.program.losses if loss.target is not None)
    noise = said.variances(inverse, frozenset(targets))
    # the deviation from a prior is one more residual, whose variance is known: 1
    spread = np.diag(_prior_spread(plan, known, products)[free])
    for name, one in said.spreads().items():
        spread += noise.get(name, 0.0) * one
    variances = np.full(len(held), np.nan)
    # the sandwich H⁻¹ S H⁻ᵀ: losses with other noise than their weights say are told right too
    covariance = inverse @ spread @ inverse.T
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
        noise={name: float(np.sqrt(variance)) for name, variance in noise.items()},
        residuals=round(sum(numbers(products, name) for name in noise)),
        covariance=_kept(parameters, weights, free, covariance),
        beside=beside,
    )


def _kept(
    parameters: Sequence[Parameter],
    weights: Mapping[str, FloatArray],
    free: IntArray,
    covariance: FloatArray,
) -> Covariance | None:
    """The covariance of all elements, with 0 for fixed ones; None with too few residuals."""
    if not np.all(np.isfinite(covariance)):
        return None
    names = [parameter.name for parameter in parameters]
    whole = np.zeros((sum(weights[name].size for name in names),) * 2)
    whole[np.ix_(free, free)] = covariance
    return Covariance.sorted_by_name(names, weights, whole)


def _beside(end: _End, weights: Mapping[str, FloatArray]) -> BesideBounds:
    """The values at bounds, by the derivative of the complete minimised total."""
    slope, curvature, total = _derivatives(end, weights)
    return beside_bounds(end.parameters, weights, slope, np.diagonal(curvature), total)


def _derivatives(
    end: _End, weights: Mapping[str, FloatArray]
) -> tuple[FloatArray, FloatArray, float]:
    """Half the gradient of the total (n), half its Hessian (n, n), and the total."""
    products, shares = end.products, shares_of(end.plan, end.products)
    slope, bent, total = _beside_data(end, weights)
    slope = slope + sum(share * products[name].slope for name, share in shares.items())
    bent = np.diag(bent) + sum(share * products[name].curvature for name, share in shares.items())
    return slope, bent, total + sum(share * products[name].cost for name, share in shares.items())


def _beside_data(
    end: _End, weights: Mapping[str, FloatArray]
) -> tuple[FloatArray, FloatArray, float]:
    """For priors and weight decay: half the gradient (n), half the curvature (n), the value."""
    plan = end.plan
    inside = in_physical_units(end.parameters)
    values = np.concatenate([weights[p.name].ravel() / p.scale for p in inside])
    scales = np.concatenate([np.full(weights[p.name].size, p.scale) for p in inside])
    decay = Decay(plan.decay_of_total, end.parameters)
    spread = _prior_weight(plan, end.products)
    terms = quadratic_terms(known_of(plan, inside), values, decay, spread)
    return terms.slope / scales, terms.curvature / scales**2, terms.value


def _prior_weight(plan: StagePlan, products: Mapping[str, Products]) -> float:
    """ŝ²/n, the weight of priors."""
    sums = {name: LossSum(one.cost, one.count) for name, one in products.items() if one.count}
    return square_by_count(plan, sums) if sums else 0.0


def _prior_spread(
    plan: StagePlan, known: KnownTerms, products: Mapping[str, Products]
) -> FloatArray:
    """The contribution of priors to the variance of the gradient, per element."""
    slope = np.where(known.std > 0, 1.0 / np.where(known.std > 0, known.std, 1.0), 0.0)
    return (_prior_weight(plan, products) * slope) ** 2

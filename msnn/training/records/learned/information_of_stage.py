"""Computes the information of a stage's residuals about its parameters, with initial states."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from backends.files.c_compiler import CompilerMissingError
from backends.gauss_newton_products import Products
from msnn.data.dataset import BoolArray, Dataset, FloatArray
from msnn.data.rollout_rows import Runs, reads
from msnn.model.weights.kept_starts import KeptStarts
from msnn.simulation.rollout_plan import counted_rows, score_some, set_rollouts
from msnn.simulation.start_fit import FoundStarts, StartFit, TakenStarts, uncertain_starts
from msnn.training.engines.native.native_engine import try_natively
from msnn.training.engines.native.native_squares import NativeSlopes
from msnn.training.engines.second_order.squares import JointStarts, SlopedSquares, without_starts
from msnn.training.plans.loss_terms import BREAD_OF, is_all_squared
from msnn.training.plans.stage_data import TRAIN
from msnn.training.plans.stage_plan import StagePlan
from msnn.training.plans.stage_result import EstimatedStarts, StageResult
from msnn.training.records.learned.held_starts import HeldStarts
from msnn.training.records.learned.information import (
    Information,
    Sandwich,
    SymmetricInformation,
    shares_of,
)
from msnn.training.records.learned.overlapping_runs import of_overlapping_runs
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings


def information_of(
    plan: StagePlan,
    data: Dataset,
    rows: Mapping[str, BoolArray] | None,
    runs: Runs,
    weights: Mapping[str, FloatArray],
    trained: TakenStarts | None = None,
) -> tuple[Information, Mapping[str, Products], tuple[Diagnostic, ...]]:
    """The information of residuals about the parameters, and the products JᵀJ and Jᵀr.

    `trained` are initial states estimated with the parameters. If None, they are estimated again:
    from all scored rows if they minimise the same sum of squares, otherwise from the first rows of
    each run.
    """
    starts = plan.rollout.starts
    if starts is None:
        squares, notes = _squares(plan, data, rows, runs, weights)
        products = squares.products(runs, weights)
        return _symmetric(plan, products, {}), products, notes
    joint = plan.fits_starts_to_all
    if trained is None:
        series = starts_at_the_end(plan, data, rows, runs, weights).series(data.rows)
    else:
        series = FoundStarts.of_none(None, trained.values, trained).series(data.rows)
    unknown = JointStarts(plan, data.series)
    moved = unknown.moved(weights)
    squares, notes = _squares(unknown.plan, data, rows, runs, moved)
    squares.write(series, watched=False)
    products = unknown.products(squares, runs, weights)
    shares = shares_of(plan, products)
    if joint:
        # what starts minimise curves as the total does: clipped residuals have no part in it
        curving = {
            name: (f"{BREAD_OF}{name}", 0.5 * share)
            if f"{BREAD_OF}{name}" in products
            else (name, share)
            for name, share in shares.items()
        }
        left, used = without_starts(products, dict(curving.values()))
        used_up = {name: used[of] for name, (of, _) in curving.items()}
        return _symmetric(plan, left, used_up), left, notes
    overlapping = _overlapping_runs(plan, data)
    if overlapping is not None:
        return of_overlapping_runs(plan, data, rows, overlapping, weights), products, notes
    # what decides a start comes first in its run: the samples that scoring skips count here
    whole = replace(unknown.plan, rollout=replace(unknown.plan.rollout, skip=0))
    assert starts.over is not None, "what is scored decides else"
    deciding = replace(runs, steps=np.minimum(runs.steps, starts.over))
    squares, _ = _squares(whole, data, None, deciding, moved)
    squares.write(series, watched=False)
    first = unknown.of_each(squares, deciding, weights)
    return HeldStarts.of_runs(products, shares, first, plan.loss_weights), products, notes


def trained_runs(runs: Runs, estimated: EstimatedStarts | None) -> tuple[Runs, TakenStarts] | None:
    """The runs whose initial states training has estimated, with these states; None without any.

    The remainder of a recording that is shorter than the horizon is not a training run.
    """
    if estimated is None:
        return None
    _, here, there = np.intersect1d(runs.t0, estimated.t0, return_indices=True)
    # shorter rollouts on the way to whole ones have other starts
    same = runs.steps[here] == estimated.steps[there]
    here, there = here[same], there[same]
    if not len(here):
        return None
    values = {name: value[there] for name, value in estimated.values.items()}
    return runs.take(here), TakenStarts(runs.t0[here], values)


def starts_at_the_end(
    plan: StagePlan,
    data: Dataset,
    rows: Mapping[str, BoolArray] | None,
    runs: Runs,
    weights: Mapping[str, FloatArray],
) -> FoundStarts:
    """The initial states of a stage's runs at these weights, estimated as in training."""
    starts = plan.rollout.starts
    assert starts is not None, "the stage fits starts"
    every = plan.fits_starts_to_all
    over, skip = (None, starts.skip) if every else (starts.over, 0)
    fit = StartFit(starts.program, over, skip, native=plan.engine != "torch")
    return fit.find(data.series, runs, weights, plan.loss_weights, rows if every else None)


def kept_starts(
    plan: StagePlan,
    data: Dataset,
    result: StageResult,
    warned: Callable[[Diagnostic], None],
) -> KeptStarts | None:
    """The estimated initial states of a stage's recordings, to save; None if a rule recomputes
    them.

    Of overlapping rollouts, those one horizon apart are used. Initial states that were estimated in
    training keep their final values. If all losses are sums of squares, the others are estimated at
    the end.
    """
    starts = plan.rollout.starts
    if starts is None or not plan.fits_starts_to_all:
        return None
    wanted_by = f"stage `{plan.name}`"
    runs = set_rollouts(plan.rollout, data, TRAIN, None, wanted_by, plan.span, Findings())
    if runs is None:
        return None
    rows = counted_rows(plan.rollout, data, TRAIN)
    # runs through whole records are runs through those of other sets too
    runs = runs.take(np.flatnonzero(score_some(runs, rows)))
    found = starts_at_the_end(plan, data, rows, runs, result.best)
    known = np.ones(len(runs), np.bool_)
    if plan.estimates_starts:
        found, estimated = _as_estimated(found, runs, result.starts)
        if not is_all_squared(plan.program, plan.loss_weights):
            # others minimise squares, not the total
            known = estimated
    for warning in uncertain_starts(found, data, wanted_by):
        warned(warning)
    program = starts.program
    wanted = [state.next for state in program.states]
    wanted += [node for loss in program.losses for node in loss.nodes]
    signals = {
        *reads(program.step, wanted),
        *reads(program.start, [s.start for s in program.states]),
    }
    decided = known & ~np.any([*found.undecided.values()], axis=0)
    if not decided.any():
        return None
    values = {name: value[decided] for name, value in found.values.items()}
    return KeptStarts.of(data, signals, found.t0[decided], values, result.best)


def _as_estimated(
    found: FoundStarts, runs: Runs, estimated: EstimatedStarts | None
) -> tuple[FoundStarts, BoolArray]:
    """The initial states as estimated in training, and the mask of runs that have them."""
    known = np.zeros(len(runs), np.bool_)
    if estimated is None:
        return found, known
    _, here, there = np.intersect1d(runs.t0, estimated.t0, return_indices=True)
    # shorter rollouts on the way to whole ones have other starts
    same = runs.steps[here] == estimated.steps[there]
    here, there = here[same], there[same]
    known[here] = True
    values = {name: value.copy() for name, value in found.values.items()}
    for name, value in values.items():
        value[here] = estimated.values[name][there]
    return replace(found, values=values, unsettled=found.unsettled & ~known), known


def _overlapping_runs(plan: StagePlan, data: Dataset) -> Runs | None:
    """The training runs; None if no row is in two of them."""
    horizon, stride = plan.rollout.horizon, plan.rollout.stride
    if not isinstance(horizon, int) or stride >= horizon:
        return None
    return set_rollouts(plan.rollout, data, TRAIN, stride, "standard errors", None, Findings())


def _symmetric(
    plan: StagePlan, products: Mapping[str, Products], used_up: Mapping[str, float]
) -> Information:
    shares = shares_of(plan, products)
    return SymmetricInformation(
        products=products,
        curvatures={name: share * products[name].curvature for name, share in shares.items()},
        shares=shares,
        used_up=used_up,
        robust={
            name: Sandwich.of_loss(name, share, products)
            for name, share in shares.items()
            if f"{BREAD_OF}{name}" in products
        },
    )


def _squares(
    plan: StagePlan,
    data: Dataset,
    rows: Mapping[str, BoolArray] | None,
    runs: Runs,
    weights: Mapping[str, FloatArray],
) -> tuple[SlopedSquares, tuple[Diagnostic, ...]]:
    """An object that computes residuals and Jacobians: kernels if possible, else torch with
    notes.
    """

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

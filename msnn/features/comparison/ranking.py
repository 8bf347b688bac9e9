"""Ranks the models of a comparison by one metric on held-out rows, and by cost."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from msnn.features.comparison import errors
from msnn.features.comparison.variants import Variant
from msnn.training.records.run_log import Measured, RunLine
from spec_schema.diagnostics.diagnostic import SpecError

Way = tuple[str, str, str]
_HIGHER = frozenset({"fit", "r2"})


@dataclass(frozen=True, slots=True)
class Criterion:
    """One metric of one output and kind of simulation, by which models are ranked."""

    way: Way | None
    """None: the monitor of the last stage, if no spec has metrics."""
    metric: str

    @property
    def is_higher_better(self) -> bool:
        return self.metric in _HIGHER

    def of(self, measured: Sequence[Measured]) -> float:
        """The metric in a list of measurements; NaN if it is missing."""
        found = (
            # by way: two specs may measure one output over different rollouts
            each.metrics.get(self.metric, math.nan)
            for each in measured
            if each.way == self.way
        )
        return next(found, math.nan)

    @property
    def heading(self) -> str:
        """The heading of its column, such as `x_next rmse [m], 50 steps`."""
        if self.way is None:
            return "monitor"
        of, rollout, unit = self.way
        shown = {"fit": " [%]"}.get(self.metric, f" [{unit}]" if unit else "")
        return f"{of} {self.metric}{shown}, {rollout}"


MONITOR = Criterion(None, "monitor")


@dataclass(frozen=True, slots=True, kw_only=True)
class Ranked:
    """A variant in the ranking with its trainings; `score` and `deviation` are mean and standard
    deviation of the criterion over seeds and folds.
    """

    variant: Variant
    lines: tuple[RunLine, ...]
    """Completed trainings."""
    failed: tuple[RunLine, ...]
    scores: tuple[float, ...]
    """The criterion on held-out rows, one value per training."""
    training_score: float
    """The criterion on the training rows."""
    is_on_front: bool = False
    """True if no other model is equally accurate at lower cost, or more accurate at equal cost."""
    is_best: bool = False

    @property
    def score(self) -> float:
        return float(np.mean(self.scores)) if self.scores else math.nan

    @property
    def deviation(self) -> float:
        """Sample standard deviation of the scores with n − 1, in the unit of the criterion. NaN for
        a single training, and with infinite scores unless all are equal, where it is 0.
        """
        # the AIC of errors that are all 0
        if not np.isfinite(self.scores).all():
            return 0.0 if len(self.scores) > 1 and len(set(self.scores)) == 1 else math.nan
        return float(np.std(self.scores, ddof=1)) if len(self.scores) > 1 else math.nan

    @property
    def is_whole(self) -> bool:
        """True if every training was completed; the mean of some folds would be too optimistic."""
        # folds that diverge are the hard ones
        return not self.failed and not math.isnan(self.score)

    @property
    def parameters(self) -> int:
        # folds may leave out more or fewer by penalties
        return max((line.parameters for line in self.lines), default=0)

    @property
    def seconds(self) -> float:
        return sum(line.seconds for line in self.lines)

    @property
    def instructions(self) -> float:
        """Instructions of one step of the C code, the mean over the trainings that were costed; NaN
        if none was.
        """
        found = [line.cost.instructions for line in self.lines if line.cost is not None]
        return float(np.mean(found)) if found else math.nan

    @property
    def flash(self) -> int | None:
        return max((line.cost.flash for line in self.lines if line.cost is not None), default=None)

    @property
    def expense(self) -> float:
        """The cost by which models are compared: instructions per step if counted, else the number
        of learned elements.
        """
        return self.parameters if math.isnan(self.instructions) else self.instructions

    def information(self, way: Way | None) -> tuple[float, float]:
        """AIC and BIC per scored value on the training rows, means over the trainings; NaN if `way`
        has no AIC.

        AIC/n = (L + 2p)/n, BIC/n = (L + p ln n)/n (Akaike 1974, Schwarz 1978). L is -2 ln of the
        likelihood of Gaussian errors, p the number of learned elements and n that of scored values.
        Smaller is better.
        """
        found: list[tuple[float, float]] = []
        for line in self.lines:
            each = next((m for m in line.training if m.way == way), None)
            if each is None or "aic" not in each.metrics or not each.scored:
                continue
            n, p = each.scored, line.parameters
            aic = each.metrics["aic"]
            # for each scored value, as variants with longer windows score fewer of them
            found.append((aic / n, (aic - 2 * p + p * math.log(n)) / n))
        if not found:
            return math.nan, math.nan
        aics, bics = zip(*found, strict=True)
        return float(np.mean(aics)), float(np.mean(bics))


def common_ways(lines: Sequence[RunLine]) -> tuple[Way, ...]:
    """The measurements that all lines contain, each as output, kind of simulation and unit, in the
    order of the first line. Empty without lines.

    Raises SpecError if there are measurements, but none in common.
    """
    if not lines:
        return ()
    shared = [each.way for each in lines[0].held_out]
    for line in lines[1:]:
        ways = {each.way for each in line.held_out}
        # in the order of the first spec, whose first entry decides what is ranked by
        left = [way for way in shared if way in ways]
        if not left and (shared or ways):
            told = (lines[0].model, _told(lines[0]), line.model, _told(line))
            raise SpecError((errors.nothing_in_common(*told),))
        shared = left
    return tuple(shared)


def _told(line: RunLine) -> list[str]:
    """Texts about the measurements of a model, such as `y in m, record`."""
    return [
        f"{of} in {unit}, {rollout}" if unit else f"{of}, {rollout}"
        for of, rollout, unit in (each.way for each in line.held_out)
    ]


def chosen_criterion(lines: Sequence[RunLine], wanted: str | None) -> Criterion:
    """The criterion `wanted`, or if None the first entry of `validate` that all `lines` have, or
    the monitor if there are no measurements.

    `fit`, `x_next.fit` and `x_next.fit:record` name a metric, its output, and the beginning of its
    simulation. Raises SpecError for a metric that is not common to all.
    """
    ways = common_ways(lines)
    shared = [each for way in ways for each in lines[0].held_out if each.way == way]
    if wanted is None:
        return Criterion(shared[0].way, shared[0].asked) if shared else MONITOR
    return named_criterion(shared, wanted)


def named_criterion(shared: Sequence[Measured], wanted: str) -> Criterion:
    """The first metric in `shared` that the text `wanted` names: `fit`, `x_next.fit` (with the
    output) or `x_next.fit:record` (with the beginning of the simulation).

    Raises SpecError if there is none.
    """
    measured, _, rollout = wanted.partition(":")
    of, _, metric = measured.rpartition(".")
    for each in shared:
        # an output may have dots itself: the metric is what stands behind the last one
        alike = of in ("", each.of) and each.rollout.startswith(rollout)
        if alike and metric in each.metrics:
            return Criterion(each.way, metric)
    names = [f"{each.of}.{metric}:{each.rollout}" for each in shared for metric in each.metrics]
    raise SpecError((errors.unknown_criterion(wanted, tuple(names)),))


def ranked(lines: Mapping[Variant, Sequence[RunLine]], criterion: Criterion) -> tuple[Ranked, ...]:
    """All variants, the most accurate first, the cheaper one of equals. Variants with failed
    trainings follow, and those without a score are last. The best one and the Pareto front are
    marked.
    """
    entries = [_ranked(variant, found, criterion) for variant, found in lines.items()]
    sign = -1.0 if criterion.is_higher_better else 1.0
    ordered = sorted(entries, key=lambda e: _order(e, sign))
    return _marked(ordered)


def _order(entry: Ranked, sign: float) -> tuple[bool, bool, float, float]:
    # False first: with a score before without, whole before not; of equals the cheaper
    return math.isnan(entry.score), not entry.is_whole, sign * entry.score, entry.expense


def _ranked(variant: Variant, found: Sequence[RunLine], criterion: Criterion) -> Ranked:
    ended = tuple(line for line in found if line.state == "finished")

    def scores(line: RunLine) -> tuple[float, float]:
        if criterion.way is None:
            return line.monitor, math.nan
        return criterion.of(line.held_out), criterion.of(line.training)

    both = [scores(line) for line in ended]
    return Ranked(
        variant=variant,
        lines=ended,
        failed=tuple(line for line in found if line.state != "finished"),
        scores=tuple(held_out for held_out, _ in both),
        training_score=float(np.mean([trained for _, trained in both])) if both else math.nan,
    )


def _marked(ordered: Sequence[Ranked]) -> tuple[Ranked, ...]:
    """The entries in the same order, with the best one and the Pareto front of accuracy and cost
    marked. `ordered` is sorted by accuracy.

    Only models with complete trainings are considered, unless there are none.
    """
    least = math.inf
    marked: list[Ranked] = []
    some_are_whole = any(entry.is_whole for entry in ordered)
    for place, entry in enumerate(ordered):  # the most accurate first, the cheaper of equals
        there = entry.is_whole if some_are_whole else not math.isnan(entry.score)
        # by falling accuracy: on the front is what costs less than all before it
        on_front = there and entry.expense < least
        least = min(least, entry.expense) if there else least
        marked.append(replace(entry, is_on_front=on_front, is_best=there and place == 0))
    return tuple(marked)


def cheapest_as_good(entries: Sequence[Ranked], criterion: Criterion) -> Ranked | None:
    """The cheapest model within one standard error of the best (Breiman et al. 1984).

    None if it is the best itself, or if the spread of the best is unknown, as of one training.
    """
    best = next((entry for entry in entries if entry.is_best), None)
    if best is None or math.isnan(best.deviation):
        return None
    # the standard error of the mean over seeds and folds
    margin = best.deviation / math.sqrt(len(best.scores))
    near = [
        entry
        for entry in entries
        # where the best is whole, a model that lost trainings does not replace it
        if entry.is_whole >= best.is_whole
        and entry.scores
        and (
            entry.score >= best.score - margin
            if criterion.is_higher_better
            else entry.score <= best.score + margin
        )
    ]
    found = min(near, key=lambda entry: entry.expense)
    return None if found is best else found

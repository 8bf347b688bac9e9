"""Estimates initial states of a stage's runs, once per epoch and before each monitor."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from msnn.data.dataset import BoolArray, Dataset, FloatArray
from msnn.data.rollout_rows import Runs
from msnn.simulation.rollout_plan import score_some
from msnn.simulation.start_fit import FoundStarts, StartFit, fit_of, uncertain_starts
from msnn.training.plans.stage_data import StageData
from msnn.training.plans.stage_plan import StagePlan
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError

Weights = Mapping[str, FloatArray]


class StageStarts:
    """Estimates the initial states of a stage's rollouts by least squares, and has the last
    result.
    """

    def __init__(
        self,
        plan: StagePlan,
        fit: StartFit,
        data: Dataset,
        rows: StageData,
        warned: Callable[[Diagnostic], None],
    ) -> None:
        self._plan, self._fit, self._data, self._warned = plan, fit, data, warned
        self._rows, self._begun = rows, False
        self.found: FoundStarts | None = None
        """The initial states of the training runs."""

    def for_training(self, runs: Runs, weights: Weights) -> dict[str, FloatArray]:
        """Estimates the initial states of training rollouts at these weights; returns them as
        series.

        A series (rows, *shape) has the initial state of a rollout at its start row.
        """
        self.found = self._find(runs, weights, self._rows.train_rows)
        return self.series()

    def for_watching(self, runs: Runs, weights: Weights) -> dict[str, FloatArray]:
        """Estimates the initial states of the monitor's rollouts at these weights; returns them as
        series.
        """
        return self._find(runs, weights, self._rows.watched_rows).series(self._data.rows)

    def series(self) -> dict[str, FloatArray]:
        """The series, by state, with the initial states of the training runs (`found`)."""
        assert self.found is not None, "nothing was found yet"
        return self.found.series(self._data.rows)

    def kept(self, runs: Runs, values: Weights) -> dict[str, FloatArray]:
        """The series with the initial states `values` of these runs, as estimated before.

        A resumed training passes the initial states of its checkpoint. They replace `found`.
        """
        none = np.zeros(len(runs), np.bool_)
        over = self._plan.rollout.starts.over if self._plan.rollout.starts is not None else None
        self.found = FoundStarts(
            t0=runs.t0, values=values, undecided={}, unsettled=none, guessed=none, over=over
        )
        return self.series()

    def values(self) -> Weights:
        """The initial values of each state for the training runs."""
        return {} if self.found is None else self.found.values

    def report(self) -> None:
        """Warns about uncertain estimates of the last epoch, unless initial states are trained like
        parameters.
        """
        if self.found is not None and not self._plan.estimates_starts:
            name = f"stage `{self._plan.name}`"
            for warning in uncertain_starts(self.found, self._data, name):
                self._warned(warning)

    def data(self) -> Dataset:
        """The data with the initial states of training runs."""
        series = self._data.series
        return (
            self._data
            if self.found is None
            else replace(self._data, series={**series, **self.series()})
        )

    def _find(
        self, runs: Runs, weights: Weights, rows: Mapping[str, BoolArray] | None
    ) -> FoundStarts:
        # the first evaluations decide whatever set their rows belong to
        starts = self._plan.rollout.starts
        scored = rows if starts is not None and starts.over is None else None
        found = self._fit.find(self._data.series, runs, weights, self._plan.loss_weights, scored)
        # runs through whole records are runs through those of other sets too: they score nothing
        found = found.doubts_of(score_some(runs, rows))
        # before the first epoch: what is trained from a guess is worth nothing
        if not self._begun and not self._plan.estimates_starts and found.guessed.any():
            raise SpecError(uncertain_starts(found, self._data, f"stage `{self._plan.name}`"))
        self._begun = True
        return found


def stage_starts(
    plan: StagePlan, data: Dataset, rows: StageData, warned: Callable[[Diagnostic], None]
) -> StageStarts | None:
    """The estimator for a stage; None if all states define their initial values."""
    # kernels fuse operations where a processor can: their bits are not those of other machines
    native = plan.engine != "torch" and not plan.reproducible
    fit = fit_of(plan.rollout, searches=plan.epochs, native=native)
    return None if fit is None else StageStarts(plan, fit, data, rows, warned)

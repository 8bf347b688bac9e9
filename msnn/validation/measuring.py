"""Evaluates an output while it is simulated, some rollouts at a time."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from msnn.data.dataset import FloatArray
from msnn.data.starts import Runs
from msnn.validation.counting import Counted
from msnn.validation.doubt import metric_in_doubt
from msnn.validation.error_sums import CurveSums, ErrorRange, RowErrors
from msnn.validation.judged_errors import NOT_JUDGED, judged_errors
from msnn.validation.measurement import METRICS, Measurement
from msnn.validation.plan import CheckPlan
from msnn.validation.ready_check import ReadyCheck
from msnn.validation.rows_text import rows_text
from msnn.validation.statistics.metrics import Errors, Scores, score
from spec_schema.sections.training import Metric

_AT_ONCE = 1 << 16
"""Samples added at once; limits the memory."""


class Measuring:
    """Accumulates one output for one kind of simulation; memory is one value per row of the
    data.
    """

    def __init__(self, check: ReadyCheck, parts: Iterable[Runs], learned: int) -> None:
        """`parts` are the rollouts that will be added; `learned` is as for `score`."""
        self.of = check.plan.of
        self._check, self._counted, self._learned = check, Counted(check), learned
        assert check.plan.target is not None
        self._target = check.data.measured_values(check.plan.target.signal)
        begin, steps, samples = np.iinfo(np.int64).max, 0, 0
        for part in parts:
            number = self._counted.among(part).number
            begin = min(begin, int(number.min(initial=begin)))
            steps = max(steps, int(number.max(initial=-1)) + 1)
            samples += len(number)
        # rollouts over whole episodes or records are few and long
        few = isinstance(check.plan.rollout.horizon, str)
        self._curve = CurveSums(min(begin, steps), steps, samples, few=few)
        # made when the first rollout is added: of many entries one is measured at a time
        self._along: tuple[ErrorRange, RowErrors] | None = None
        """Allocated from the first rollouts to the last, so that one entry at a time uses
        memory.
        """
        self._errors = Errors.of(self._target[:0], self._target[:0])
        self._largest = 0.0

    def add(self, part: Runs, output: FloatArray) -> None:
        """Adds the simulated values of some rollouts."""
        if self._along is None:
            rows = self._check.data.rows
            self._along = ErrorRange(rows), RowErrors(rows, self._target.shape[1:])
        along, counting = self._along, self._counted.among(part)
        # some at a time: temporary arrays stay small however long the data are
        for begin in range(0, len(counting.rows), _AT_ONCE):
            some = slice(begin, begin + _AT_ONCE)
            rows = counting.rows[some]
            prediction, target = output[counting.steps[some]], self._target[rows]
            self._errors = self._errors + Errors.of(prediction, target)
            self._curve.add(prediction, target, counting.number[some])
            for each in along:
                each.add(prediction, target, rows)
            # a size to which rounding is relative: predictions that are not finite have none
            size = np.abs(prediction[np.isfinite(prediction)])
            self._largest = max(self._largest, float(size.max(initial=0.0)))

    def is_in_doubt(self, plan: CheckPlan) -> bool:
        """True if a limit of an entry lies within the possible difference between engines."""
        return metric_in_doubt(plan, self._errors, self._largest, self._learned)

    def measurement(self, *, judges: bool) -> Measurement:
        """The measurement of all parts; `judges` adds the analysis of errors."""
        assert self._along is not None, "there are rollouts"
        # handed over and let go: the next entry may need the memory
        (extremes, by_row), self._along = self._along, None
        check, rollout = self._check, self._check.plan.rollout
        metrics: dict[Metric, Scores] = {
            metric: score(metric, self._errors, self._learned) for metric in METRICS
        }
        rows = by_row.rows
        # rows without a target are simulated, not scored (R9)
        there = ~np.isnan(self._target[rows].reshape(len(rows), -1)).all(axis=1)
        return Measurement(
            of=check.plan.of,
            unit=check.plan.error_unit,
            horizon=str(rollout.horizon),
            closed=rollout.closed,
            details=check.plan.details,
            data=check.name,
            rows=rows_text(check.data, rows[there]),
            scored=metrics["rmse"].count,
            metrics=metrics,
            curve=self._curve.curve(),
            trace=extremes.trace(),
            judged=judged_errors(check, rows, by_row.errors) if judges else NOT_JUDGED,
        )

"""Combines an entry of `validate` with its rollouts and data, and selects scored predictions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from compiler.ir.nodes import Extent
from msnn.data.dataset import Dataset, FloatArray, IntArray
from msnn.data.rollout_rows import Runs, rows_that_count
from msnn.model.weights.kept_starts import KeptStarts
from msnn.simulation.engines.engine import first_places
from msnn.simulation.rollout import check_classes, check_row_factors
from msnn.simulation.rollout_plan import counted_rows, set_rollouts
from msnn.simulation.start_fit import with_starts
from msnn.validation.plan import CheckPlan, default_set
from spec_schema.diagnostics.diagnostic import Findings


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadyCheck:
    """An entry of `validate` with its plan, its rollouts and the data that they run on."""

    plan: CheckPlan
    name: str
    """Name of the set."""
    runs: Runs
    data: Dataset
    series: Mapping[str, FloatArray]
    """The series that the rollouts read, from the data."""

    def is_simulated_as(self, other: ReadyCheck) -> bool:
        """True if the same rollouts serve both entries."""
        same = self.name == other.name and self.data is other.data
        return same and self.plan.rollout == other.plan.rollout

    def is_measured_as(self, other: ReadyCheck) -> bool:
        """True if the entries differ in metric and limits only."""
        same = self.plan.of == other.plan.of and self.plan.target == other.plan.target
        return same and self.is_simulated_as(other)


def ready_check(
    plan: CheckPlan,
    data: Dataset | None,
    on: str | None,
    files: Mapping[str, Dataset],
    findings: Findings,
) -> ReadyCheck | None:
    """Finds the rollouts of an entry; None after reporting errors to `findings`.

    They are in the set `on` if given, else in the entry's own files or set.
    """
    measured = files[plan.data] if plan.from_files and plan.data and not on else data
    assert measured is not None, "only entries with files do without data"
    name = on or plan.data or default_set(measured)
    wanted_by = f"the metric of `{plan.of}`"
    # None: a horizon apart, so that each row is scored once, and a shorter one for the rest (R2)
    stride = None if plan.rollout.stride == plan.rollout.horizon else plan.rollout.stride
    ahead = plan.target.ahead if plan.target is not None else 0
    # rows of the target must be there, also where it is another than what the output predicts
    also = Extent(min(ahead, 0), max(ahead, 0))
    runs = set_rollouts(plan.rollout, measured, name, stride, wanted_by, plan.span, findings, also)
    if runs is None:
        return None
    if plan.metric is None:
        counted = counted_rows(plan.rollout, measured, name)
        check_row_factors(plan.rollout.program, measured, runs, counted, findings)
        check_classes(plan.rollout.program, measured, runs, findings)
    return ReadyCheck(plan=plan, name=name, runs=runs, data=measured, series=measured.series)


def with_found_starts(
    checks: Sequence[ReadyCheck],
    weights: Mapping[str, FloatArray] | None,
    findings: Findings,
    kept: KeptStarts | None = None,
) -> list[ReadyCheck]:
    """The entries, with initial states of their rollouts added to the data where they must be
    estimated.

    Entries with the same rollouts share estimates; warnings go to `findings`. `kept` are saved
    initial states of the training. Raises SpecError if the data do not determine an initial state.
    """
    found: list[ReadyCheck] = []
    for index, check in enumerate(checks):
        alike = next((i for i in range(index) if check.is_simulated_as(checks[i])), None)
        if alike is not None:
            data, rollout = found[alike].data, found[alike].plan.rollout
        else:
            wanted_by = f"the metric of `{check.plan.of}`"
            rollout = check.plan.rollout
            rows = counted_rows(rollout, check.data, check.name)
            rollout, data = with_starts(
                rollout,
                check.data,
                check.runs,
                weights,
                wanted_by,
                findings,
                rows=rows,
                kept=kept,
            )
        plan = replace(check.plan, rollout=rollout)
        found.append(replace(check, plan=plan, data=data, series=data.series))
    findings.raise_errors()
    return found


@dataclass(frozen=True, slots=True)
class Counting:
    """The scored steps of some rollouts: positions among all their steps, and rows of the data."""

    steps: IntArray
    """Positions of these steps among all steps."""
    rows: IntArray
    """Rows of the series that are predicted."""
    number: IntArray
    """Index of each step within its rollout, from 0."""


class Counted:
    """Selects the steps of an entry's rollouts that its metric counts."""

    def __init__(self, check: ReadyCheck) -> None:
        plan = check.plan
        assert plan.target is not None
        self._ahead, self._skip = plan.target.ahead, plan.rollout.skip
        # of whole records all rows are simulated, and those of the set are scored (R10)
        name = check.name if plan.rollout.horizon == "record" else None
        around = Extent(self._ahead, self._ahead)
        self._rows = rows_that_count(check.data, name, around, plan.rollout.skip_rows)

    def among(self, runs: Runs) -> Counting:
        """The scored steps of some of the rollouts."""
        # the place within all rollouts, less where its own begins: 0, 1, 2, … again and again
        number = np.arange(int(runs.steps.sum()))
        number -= np.repeat(first_places(runs), runs.steps)
        t = np.repeat(runs.t0, runs.steps)
        t += number
        steps = np.flatnonzero((number >= self._skip) & self._rows[t])
        return Counting(steps, t[steps] + self._ahead, number[steps])

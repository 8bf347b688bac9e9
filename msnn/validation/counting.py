"""Selects the scored predictions of rollouts, and the rows that they predict."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from compiler.ir.nodes import Extent
from msnn.data.dataset import IntArray
from msnn.data.scored import rows_that_count
from msnn.data.starts import Runs
from msnn.simulation.engines.engine import first_places
from msnn.validation.ready_check import ReadyCheck


@dataclass(frozen=True, slots=True)
class Counting:
    """The scored steps of some rollouts, rollout after rollout."""

    steps: IntArray
    """Positions of these steps among all steps."""
    rows: IntArray
    """Rows of the series that are predicted."""
    number: IntArray
    """Index of each step within its rollout, from 0."""


class Counted:
    """Selects the scored steps of an entry's rollouts."""

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

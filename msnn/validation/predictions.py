"""Chooses the predictions of rollouts that count, and puts their targets beside them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from compiler.ir.liveness import Extent
from msnn.data.dataset import FloatArray, IntArray
from msnn.data.scored import rows_that_count
from msnn.simulation.engines.engine import first_places
from msnn.validation.ready_check import ReadyCheck


@dataclass(frozen=True, slots=True)
class Predictions:
    """What counts of the predictions of an output, in order of the rows that they are for."""

    prediction: FloatArray
    """(samples, *shape)."""
    target: FloatArray
    rows: IntArray
    """Of the series."""
    number: IntArray
    """Of each within its rollout, from 0."""


def predictions(check: ReadyCheck, output: FloatArray) -> Predictions:
    """Those that count; `output` has the values of every rollout, one after the other."""
    plan, runs = check.plan, check.runs
    assert plan.target is not None
    ahead = plan.target.ahead
    first = first_places(runs)
    number = np.arange(len(output)) - np.repeat(first, runs.steps)
    t = np.repeat(runs.t0, runs.steps) + number
    whole = plan.rollout.horizon == "record"
    name = check.name if whole else None
    counting = rows_that_count(check.data, name, Extent(ahead, ahead), plan.rollout.skip_rows)
    counts = (number >= plan.rollout.skip) & counting[t]
    if not counts.all():
        output, t, number = output[counts], t[counts], number[counts]
    if np.any(t[1:] < t[:-1]):  # rollouts that overlap
        order = np.argsort(t, kind="stable")
        output, t, number = output[order], t[order], number[order]
    rows = t + ahead
    return Predictions(output, check.data.series[plan.target.signal][rows], rows, number)

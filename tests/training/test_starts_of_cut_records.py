"""Starts that are fitted where a record goes on with rows that no loss of the stage scores."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from msnn.training.plans.stage_plan import plan_stages
from msnn.training.records.learned.standard_errors import standard_errors
from msnn.training.train import TrainingOptions, train
from spec_schema.diagnostics.diagnostic import Findings
from tests.conditions import require_tool
from tests.training.cases import compiled, dataset
from tests.training.oscillator import FITTED, records


def test_rows_that_are_held_out_at_the_end_change_no_standard_error() -> None:
    """`split: {by: fraction}` cuts a record; `rollout: record` simulates all of it."""
    require_tool("gcc", install="apt install gcc")
    stage = "train:\n  - {epochs: 30, rollout: record, optimizer: levenberg_marquardt}\n"
    program, spec = compiled(FITTED + stage)
    series = records(1, 90, seed=6)
    whole = dataset(series, train=[90])
    last = (np.arange(90) >= 60).astype(np.int8)
    cut = replace(whole, sets=("train", "val"), set_of_row=last)
    alone = dataset({name: values[:60] for name, values in series.items()}, train=[60])
    (plan,) = plan_stages(program, spec.train, Findings())
    weights = train(program, alone, spec.train, TrainingOptions(runs=None)).weights
    found, expected = (standard_errors(plan, data, weights) for data in (cut, alone))
    assert found.residuals == expected.residuals == 60
    for name in ("k", "d"):
        # the starts are found again, each to the tolerance of its own descent
        assert found.errors[name] == pytest.approx(expected.errors[name], rel=1e-6)
    assert (
        train(program, cut, spec.train, TrainingOptions(runs=None)).weights.keys() == weights.keys()
    )

"""What has a monitor that is not finite leads nothing, wherever the best of several counts."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from msnn.reports.run_summary import read_run
from msnn.reports.training_summary import Recorded
from msnn.training.folds import Fold, FoldsResult
from msnn.training.plans.stage_result import StageResult
from msnn.training.records.progress import EpochEnd, Silent
from msnn.training.records.run_folder import METRICS
from msnn.training.stages.stage_run import StageAttempts

NAN, INF = float("nan"), float("inf")
ORDERS = [(NAN, 0.5, 2.0), (0.5, NAN, 2.0), (INF, NAN, 0.5), (2.0, 0.5, NAN), (NAN, INF, 0.5)]
"""Values of three attempts; 0.5 is always the best."""


def _ended(number: int, value: float) -> StageResult:
    return StageResult(
        best={"a": np.array([value])},
        best_value=value,
        best_epoch=1,
        epochs=1,
        reason="done",
        seconds=0.0,
        attempt=number,
    )


def _epoch(number: int, value: float) -> EpochEnd:
    return EpochEnd(
        stage="0",
        attempt=number + 1,
        attempts=3,
        epoch=1,
        epochs=1,
        total=1.0,
        losses={"y": 1.0},
        monitor=value,
        best=value,
        best_epoch=1,
        lr=None,
        horizon=1,
        seconds=0.0,
    )


@pytest.mark.parametrize("values", ORDERS)
def test_the_finite_attempt_leads(values: tuple[float, ...]) -> None:
    def opened(number: int) -> Any:
        result = _ended(number, values[number])
        return SimpleNamespace(
            attempt=number, best=result.best, best_value=result.best_value, run=lambda: result
        )

    plan = cast("Any", SimpleNamespace(attempts=3))
    attempts = StageAttempts(plan, opened, lambda run, fault: None)
    assert attempts.run().best_value == 0.5
    assert attempts.best == {"a": np.array([0.5])}


@pytest.mark.parametrize("values", ORDERS)
def test_reports_show_the_attempt_that_leads(values: tuple[float, ...], tmp_path: Path) -> None:
    events = [_epoch(number, value) for number, value in enumerate(values)]
    heard = Recorded(Silent(), keeps_epochs=True)
    for event in events:
        heard.epoch_ended(event)
    assert [epochs[-1].best for epochs in heard.epochs] == [0.5]
    # a file of JSON has null for what is not finite
    lines = [
        json.dumps({k: v if v == v and v != INF else None for k, v in event.record().items()})
        for event in events
    ]
    (tmp_path / METRICS).write_text("\n".join(lines), encoding="utf-8")
    record: dict[str, Any] = {
        "format": 1,
        "program": "p",
        "data": {"rows": {}, "files": []},
        "stages": [],
        "versions": {},
        "spec_sha256": "0" * 64,
    }
    (tmp_path / "run.json").write_text(json.dumps(record), encoding="utf-8")
    (stage,) = read_run(tmp_path).stages
    assert stage.reached.best == 0.5


@pytest.mark.parametrize("values", ORDERS)
def test_latest_leads_to_a_finite_fold(values: tuple[float, ...]) -> None:
    folds = tuple(
        Fold(
            number, cast("Any", SimpleNamespace(stages=[_ended(number, value)])), cast("Any", None)
        )
        for number, value in enumerate(values)
    )
    assert FoldsResult(folds, None, len(folds)).best.monitor == 0.5

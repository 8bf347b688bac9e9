"""`lr: auto`: a range test before the first epoch, the same in every engine and after a resume."""

from __future__ import annotations

import json
import os
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from msnn.data.dataset import FloatArray
from msnn.training.records.progress import EpochEnd, Silent
from msnn.training.stages.rate_search import RATIO, STEPS
from msnn.training.train import TrainingOptions, TrainingResult, train
from msnn.training.training_result import TrainingInterruptedError
from tests.conditions import require_tool
from tests.training.cases import compiled, dataset

LINE = """
msnn: 1
name: line
inputs: {u: 1}
targets: {y: 1}
parameters: {a: 0, b: 0}
outputs: {z: {expr: a * u + b, predicts: "y[t]"}}
train: [{STAGE}]
"""
U = np.random.default_rng(2).normal(size=96)


class Rates(Silent):
    """Keeps the rate of every epoch."""

    def __init__(self) -> None:
        self.rates: list[float | None] = []

    def epoch_ended(self, event: EpochEnd) -> None:
        self.rates.append(event.lr)


def run(
    stage: str,
    size: float,
    options: TrainingOptions | None = None,
    hears: type[Rates] = Rates,
) -> tuple[TrainingResult, Rates]:
    program, spec = compiled(LINE.replace("STAGE", stage))
    heard = hears()
    series: dict[str, FloatArray] = {"u": U, "y": size * (2 * U - 1)}
    data = dataset(series, train=[len(U)])
    return train(program, data, spec.train, options or TrainingOptions(runs=None), heard), heard


@pytest.mark.parametrize("optimiser", ["adam", "adamw", "sgd"])
def test_both_engines_find_the_same_rate(optimiser: str) -> None:
    require_tool("gcc", install="apt install gcc")
    stage = f"optimizer: {{{optimiser}: {{lr: auto}}}}, batch: 32, dtype: float64, epochs: 5"
    (native, first), (torch, other) = (
        run(f"{stage}, engine: {engine}", 1.0) for engine in ("native", "torch")
    )
    assert first.rates == other.rates
    assert native.weights["a"] == pytest.approx(float(torch.weights["a"]), rel=1e-9)


def test_the_rate_follows_how_far_there_is_to_go() -> None:
    require_tool("gcc", install="apt install gcc")
    stage = "optimizer: {adam: {lr: auto}}, batch: 32, epochs: 60, schedule: {cosine: {}}"
    _, small = run(stage, 0.01)
    found, large = run(stage, 1.0)
    assert small.rates[0] is not None
    assert large.rates[0] is not None
    assert 1e-5 < small.rates[0] < 0.1 * large.rates[0]
    assert found.weights["a"] == pytest.approx(2.0, abs=0.05)


def test_a_run_keeps_what_was_found_and_the_stage_says_auto(tmp_path: Path) -> None:
    require_tool("gcc", install="apt install gcc")
    stage = "optimizer: {sgd: {lr: auto}}, batch: 32, epochs: 2, schedule: {step: {every: 1}}"
    found, heard = run(stage, 1.0, TrainingOptions(runs=tmp_path))
    assert found.folder is not None
    record = json.loads((found.folder / "run.json").read_text())
    assert record["stages"][0]["optimizer"]["sgd"]["lr"] == "auto"
    (rate,) = record["end"]["rates"].values()
    assert heard.rates == [rate, pytest.approx(0.1 * rate)]


def test_a_run_that_goes_on_still_says_what_was_said_before(tmp_path: Path) -> None:
    """Of stages that are over: a rate that was found, why they ended, that one learned nothing."""
    require_tool("gcc", install="apt install gcc")
    idle = "{optimizer: {sgd: {lr: 1e-30}}, epochs: 1}"
    stages = f"optimizer: {{sgd: {{lr: auto}}}}, epochs: 1}}, {idle}, {{epochs: 9"
    whole, _ = run(stages, 1.0, TrainingOptions(runs=tmp_path / "whole"))

    class Stopping(Rates):
        def epoch_ended(self, event: EpochEnd) -> None:
            super().epoch_ended(event)
            if event.stage == "stage_3":
                os.kill(os.getpid(), signal.SIGINT)

    options = TrainingOptions(runs=tmp_path / "parts")
    with pytest.raises(TrainingInterruptedError):
        run(stages, 1.0, options, Stopping)
    parts, _ = run(stages, 1.0, replace(options, resume=True))
    assert whole.folder is not None
    assert parts.folder is not None
    said, expected = (
        json.loads((folder / "run.json").read_text())["end"]
        for folder in (parts.folder, whole.folder)
    )
    assert (len(expected["rates"]), len(expected["stages"])) == (1, 3)
    assert any("`stage_2` has learned nothing" in line for line in expected["warnings"])
    assert said == expected


def test_the_rates_that_are_tried_go_up_to_ten() -> None:
    assert pytest.approx(10.0) == 1e-5 * RATIO ** (STEPS - 1)
    assert pytest.approx(10 ** (1 / 8), rel=1e-15) == RATIO

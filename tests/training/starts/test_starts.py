"""`starts: n`: a stage runs n times from other initial values, and the best run counts (R12)."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from compiler.elaboration.compile import compile_spec
from compiler.ir.program import Program
from msnn.data.dataset import Dataset, FloatArray
from msnn.model.weights.weights_file import initial_weights
from msnn.training import train as training_run
from msnn.training.engines.open_engine import OpenedEngine
from msnn.training.plans.stage_data import StageData
from msnn.training.plans.stage_plan import StagePlan
from msnn.training.records.progress import EpochEnd, Silent, StageEnd
from msnn.training.records.training_options import TrainingOptions
from msnn.training.train import train
from msnn.training.training_result import (
    TrainingDivergedError,
    TrainingInterruptedError,
    TrainingResult,
)
from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.sections.spec import Spec
from tests.training.cases import compiled, dataset, gain_series

NET = """msnn: 1
name: net
sample_time: 1 s
inputs: {x: m, u: m}
parameters: {b: 0.1, a: {init: {uniform: {min: -0.9, max: 0.9}}}}
layers: {net: {mlp: {hidden: [4]}}}
outputs: {x_next: {expr: "a*x + b*u + net(x, u)", predicts: "x[t+1]"}}
train:
"""
FAR = """msnn: 1
name: far
sample_time: 1 s
inputs: {x: m}
parameters: {a: {init: {uniform: {min: 0, max: 10}}}}
outputs: {x_next: {expr: "a*x", predicts: "x[t+1]"}}
train:
  - {rollout: 22, epochs: 2, starts: 6, batch: 30}
"""


class Heard(Silent):
    """Keeps the events; sends Ctrl-C when the given epoch of the given run ends."""

    def __init__(self, interrupt: tuple[int, int] | None = None) -> None:
        self.epochs: list[EpochEnd] = []
        self.ends: list[StageEnd] = []
        self.warnings: list[Diagnostic] = []
        self._interrupt = interrupt

    def epoch_ended(self, event: EpochEnd) -> None:
        self.epochs.append(event)
        if (event.attempt, event.epoch) == self._interrupt:
            os.kill(os.getpid(), signal.SIGINT)

    def stage_ended(self, event: StageEnd) -> None:
        self.ends.append(event)

    def warned(self, diagnostic: Diagnostic) -> None:
        self.warnings.append(diagnostic)


def data() -> Dataset:
    return dataset(gain_series(150), train=[70], val=[40])


def run(
    model: tuple[Program, Spec],
    heard: Heard,
    runs: Path | None = None,
    *,
    resume: bool = False,
    weights: dict[str, FloatArray] | None = None,
    series: Dataset | None = None,
) -> TrainingResult:
    program, spec = model

    def redrawn(draw: int) -> dict[str, FloatArray]:
        return initial_weights(compile_spec(spec, draw=draw).program)

    options = TrainingOptions(runs=runs, resume=resume, redrawn=redrawn)
    return train(program, series or data(), spec.train, options, heard, weights)


def net(stages: str) -> tuple[Program, Spec]:
    return compiled(NET + stages)


def test_the_best_run_counts(tmp_path: Path) -> None:
    heard = Heard()
    found = run(net("  - {epochs: 4, batch: 16, starts: 3}\n"), heard, tmp_path)
    best = [min(e.best for e in heard.epochs if e.attempt == number) for number in (1, 2, 3)]
    assert len(set(best)) == 3
    (stage,) = found.stages
    assert stage.best_value == min(best)
    assert stage.attempt == best.index(min(best))
    assert heard.ends[0].attempt == stage.attempt + 1
    for name, weight in stage.best.items():
        np.testing.assert_array_equal(found.weights[name], weight)
    assert found.folder is not None
    lines = (found.folder / "metrics.jsonl").read_text().splitlines()
    numbers = [(line["attempt"], line["epoch"]) for line in map(json.loads, lines)]
    assert numbers == [(attempt, epoch) for attempt in (1, 2, 3) for epoch in (1, 2, 3, 4)]


def test_the_first_run_is_that_of_a_stage_without_starts() -> None:
    alone, several = Heard(), Heard()
    run(net("  - {epochs: 3, batch: 16}\n"), alone)
    run(net("  - {epochs: 3, batch: 16, starts: 2}\n"), several)
    assert [e.total for e in alone.epochs] == [e.total for e in several.epochs if e.attempt == 1]


def test_both_engines_choose_alike() -> None:
    results: list[TrainingResult] = []
    for engine in ("native", "torch"):
        stage = f"  - {{epochs: 4, batch: 16, starts: 3, dtype: float64, engine: {engine}}}\n"
        results.append(run(net(stage), Heard()))
    native, torch = (found.stages[0] for found in results)
    assert native.attempt == torch.attempt
    assert native.best_value == pytest.approx(torch.best_value, rel=1e-9)


def test_only_what_nothing_has_changed_is_drawn_again(monkeypatch: pytest.MonkeyPatch) -> None:
    program, spec = net("  - {epochs: 1, starts: 2}\n")
    given = {name: w.copy() for name, w in initial_weights(program).items()}
    given["net.weight1"] += 0.5
    begins: list[Mapping[str, FloatArray]] = []
    opened = training_run.open_engine

    def remembered(
        plan: StagePlan,
        series: Mapping[str, FloatArray],
        weights: Mapping[str, FloatArray],
        stage: StageData,
    ) -> OpenedEngine:
        begins.append(weights)
        return opened(plan, series, weights, stage)

    monkeypatch.setattr(training_run, "open_engine", remembered)
    run((program, spec), Heard(), weights=given)
    first, second = begins
    changed = {name for name in first if not np.array_equal(second[name], first[name])}
    # `b` and the biases are numbers of the spec, weight1 was given
    assert changed == {"a", "net.weight2"}


def test_runs_that_begin_alike_are_a_warning() -> None:
    drawn, same, after = Heard(), Heard(), Heard()
    run(net("  - {epochs: 1, starts: 2}\n"), drawn)
    # one epoch moves little
    assert {one.code for one in drawn.warnings} <= {"W0937"}
    frozen = 'freeze: [a, "net.weight*"]'  # biases and `b` are numbers
    run(net(f"  - {{epochs: 1, starts: 2, {frozen}}}\n"), same)
    (warning,) = (said for said in same.warnings if said.code != "W0912")
    assert (warning.code, "the 2 runs" in warning.message) == ("W0940", True)
    run(net("  - {epochs: 1}\n  - {epochs: 1, starts: 2}\n"), after)
    assert "W0940" in [warning.code for warning in after.warnings]


def test_runs_that_diverge_are_left_out() -> None:
    heard = Heard()
    series = dataset({"x": np.full(60, 1e3)}, train=[60])
    found = run(compiled(FAR), heard, series=series)
    left_out = [warning for warning in heard.warnings if warning.code == "W0906"]
    assert 0 < len(left_out) < 6
    assert "is left out: stage `stage_1` diverged" in left_out[0].message
    assert np.isfinite(found.stages[0].best_value)
    assert np.isfinite(found.weights["a"])


def test_the_stage_diverges_where_all_runs_do() -> None:
    heard = Heard()
    series = dataset({"x": np.full(60, 1e36)}, train=[60])
    with pytest.raises(TrainingDivergedError) as caught:
        run(compiled(FAR), heard, series=series)
    assert caught.value.diagnostic.code == "E0913"
    assert [warning.code for warning in heard.warnings] == ["W0906"] * 5


@pytest.mark.parametrize("at", [(1, 2), (2, 3), (3, 1)])
def test_a_run_in_the_middle_can_be_resumed(at: tuple[int, int], tmp_path: Path) -> None:
    model = net("  - {epochs: 4, batch: 16, starts: 3}\n  - {epochs: 2}\n")
    undisturbed = run(model, Heard())
    with pytest.raises(TrainingInterruptedError):
        run(model, Heard(interrupt=at), tmp_path)
    resumed = run(model, Heard(), tmp_path, resume=True)
    for name, value in undisturbed.weights.items():
        np.testing.assert_array_equal(resumed.weights[name], value)
    assert resumed.stages[0].attempt == undisturbed.stages[0].attempt

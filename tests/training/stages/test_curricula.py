"""`curriculum:` trains on shorter rollouts first; the whole horizon decides what is best (R12)."""

from __future__ import annotations

import numpy as np
import pytest

from msnn.training.plans.stage_data import stage_data
from msnn.training.plans.stage_plan import plan_stages
from msnn.training.train import TrainingOptions, TrainingResult, train
from spec_schema.diagnostics.diagnostic import Findings, SpecError
from tests.conditions import require_tool
from tests.training.cases import dataset, gain, gain_series
from tests.training.stages.test_schedules import Epochs

RAISED = "rollout: {horizon: 6, curriculum: {2: 2, 4: 3 s}}"


def run(stage: str) -> tuple[TrainingResult, Epochs]:
    program, spec = gain(f"  - {{batch: 16, dtype: float64, {stage}}}\n")
    heard = Epochs()
    data = dataset(gain_series(150), train=[70], val=[40])
    return train(program, data, spec.train, TrainingOptions(runs=None), heard), heard


def test_the_horizon_is_raised_at_its_epochs() -> None:
    _, heard = run(f"epochs: 6, {RAISED}")
    assert [event.horizon for event in heard.events] == [2, 2, 3, 3, 6, 6]


def test_both_engines_train_alike() -> None:
    require_tool("gcc", install="apt install gcc")
    losses = [
        [event.total for event in run(f"epochs: 6, {RAISED}, engine: {engine}")[1].events]
        for engine in ("native", "torch")
    ]
    assert losses[0] == pytest.approx(losses[1], rel=1e-9)


def test_each_lesson_has_every_start_of_its_horizon() -> None:
    program, spec = gain(f"  - {{epochs: 6, {RAISED}}}\n")
    (plan,) = plan_stages(program, spec.train, Findings())
    found = stage_data(plan, dataset(gain_series(100), train=[60], val=[30]), Findings())
    assert found is not None
    assert [len(lesson.runs) for lesson in found.lessons] == [58, 57]
    assert len(found.train) == 54
    assert np.all(found.watched.steps[:-1] == 6)


def test_the_monitor_runs_the_whole_horizon_from_the_first_epoch() -> None:
    _, whole = run("epochs: 3, rollout: 6, optimizer: {sgd: {lr: 1e-12}}")
    _, raised = run(
        "epochs: 3, rollout: {horizon: 6, curriculum: {2: 2}}, optimizer: {sgd: {lr: 1e-12}}"
    )
    assert [e.monitor for e in raised.events] == pytest.approx([e.monitor for e in whole.events])


def test_patience_begins_with_the_whole_horizon() -> None:
    # far too fast to improve anything
    still = "optimizer: {sgd: {lr: 30}}, clip: 1, early_stop: {patience: 2}"
    result, _ = run(f"epochs: 9, {still}, rollout: {{horizon: 6, curriculum: {{4: 2}}}}")
    assert result.stages[0].epochs == 6


@pytest.mark.parametrize("horizon", ["episode", "6 s"])
def test_what_it_leads_to(horizon: str) -> None:
    _, heard = run(f"epochs: 3, rollout: {{horizon: {horizon}, curriculum: {{1: 2, 2: 4}}}}")
    steps = [event.horizon for event in heard.events]
    assert steps == [2, 4, {"episode": 69, "6 s": 6}[horizon]]


@pytest.mark.parametrize(
    ("rollout", "problem"),
    [
        ("{horizon: 6, curriculum: {9: 2}}", "epoch 9 is not before the last one, 9"),
        ("{horizon: 6, curriculum: {4: 2, 3: 4}}", "epoch 3 does not come after epoch 4"),
        ("{horizon: 6, curriculum: {2: 3, 4: 3}}", "3 evaluations are not more than the 3 before"),
        ("{horizon: 6, curriculum: {2: 6}}", "6 evaluations are not fewer than the horizon, 6"),
        ("{horizon: 6, skip: 2, curriculum: {2: 2}}", "skip 2 leaves nothing of 2 evaluations"),
        ("{horizon: record, curriculum: {2: 2}}", "`horizon: record` runs each record once"),
    ],
)
def test_what_does_not_lead_to_the_horizon(rollout: str, problem: str) -> None:
    with pytest.raises(SpecError) as caught:
        run(f"epochs: 9, rollout: {rollout}")
    (found,) = caught.value.diagnostics
    assert found.code == "E0940"
    assert problem in found.message

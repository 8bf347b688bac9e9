"""`schedule:` changes the learning rate epoch by epoch, alike in both engines and in torch."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from msnn.model.weights.weights_file import initial_weights
from msnn.training.engines.native.native_engine import NativeEngine
from msnn.training.engines.torch.torch_engine import TorchEngine
from msnn.training.plans.epochs import NO_REDUCTIONS, Rule, after_epoch, rate_factor
from msnn.training.plans.stage_data import stage_data
from msnn.training.plans.stage_plan import plan_stages
from msnn.training.records.progress import EpochEnd, Silent
from msnn.training.train import TrainingOptions, train
from spec_schema.diagnostics.diagnostic import Findings
from tests.conditions import require_tool
from tests.training.cases import dataset, gain, gain_series

EPOCHS = 12
SCHEDULES = {
    "cosine": "{cosine: {to: 0.1}}",
    "exponential": "{exponential: {factor: 0.8}}",
    "step": "{step: {every: 5, factor: 0.3}}",
    "plateau": "{plateau: {patience: 1, factor: 0.5, min: 0.2}}",
}


class Epochs(Silent):
    """Keeps what each epoch said."""

    def __init__(self) -> None:
        self.events: list[EpochEnd] = []

    def epoch_ended(self, event: EpochEnd) -> None:
        self.events.append(event)


def run(stage: str) -> list[EpochEnd]:
    program, spec = gain(f"  - {{epochs: {EPOCHS}, batch: 16, dtype: float64, {stage}}}\n")
    data = dataset(gain_series(150), train=[70], val=[40])
    heard = Epochs()
    train(program, data, spec.train, TrainingOptions(runs=None), heard)
    return heard.events


def rule(text: str) -> Rule:
    program, spec = gain(f"  - {{epochs: {EPOCHS}, schedule: {text}}}\n")
    (plan,) = plan_stages(program, spec.train, Findings())
    return plan.schedule


@pytest.mark.parametrize("kind", ["cosine", "exponential", "step"])
def test_rates_are_those_of_torch(kind: str) -> None:
    optimizer = torch.optim.SGD([torch.zeros(1, requires_grad=True)], lr=1.0)
    theirs = {
        "cosine": torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, EPOCHS, eta_min=0.1),
        "exponential": torch.optim.lr_scheduler.ExponentialLR(optimizer, 0.8),
        "step": torch.optim.lr_scheduler.StepLR(optimizer, 5, 0.3),
    }[kind]
    optimizer.param_groups[0]["lr"] = 1.0
    for epoch in range(EPOCHS):
        ours = rate_factor(rule(SCHEDULES[kind]), epoch, EPOCHS, NO_REDUCTIONS)
        assert ours == pytest.approx(optimizer.param_groups[0]["lr"], rel=1e-12)
        optimizer.step()
        theirs.step()


def test_a_plateau_lowers_the_rate_after_its_patience_and_not_below_the_least() -> None:
    plateau = rule("{plateau: {patience: 3, factor: 0.5, min: 0.2}}")
    reductions, found = NO_REDUCTIONS, list[float]()
    for epoch in range(EPOCHS):
        found.append(rate_factor(plateau, epoch, EPOCHS, reductions))
        reductions = after_epoch(plateau, epoch + 1, 2 if epoch >= 1 else 0, reductions)
    # the last better monitor is that of epoch 2: lowered after epochs 5, 8 and 11
    assert found == [1.0] * 5 + [0.5] * 3 + [0.25] * 3 + [0.2]


@pytest.mark.parametrize("optimizer", ["adam: {lr: 0.5}", "sgd: {lr: 0.5, momentum: 0.9}"])
@pytest.mark.parametrize("kind", SCHEDULES)
def test_both_engines_train_alike(kind: str, optimizer: str) -> None:
    require_tool("gcc", install="apt install gcc")
    stage = f"optimizer: {{{optimizer}}}, schedule: {SCHEDULES[kind]}, engine: "
    native, other = run(stage + "native"), run(stage + "torch")
    assert len({event.lr for event in native}) > 1
    assert [event.lr for event in native] == [event.lr for event in other]
    losses = [event.total for event in other]
    assert [event.total for event in native] == pytest.approx(losses, rel=1e-9)


def test_factors_of_parameters_stay() -> None:
    """Plain descent moves in proportion to the rate: half the factor is half the way."""
    program, spec = gain(
        "  - {epochs: 1, batch: 999, optimizer: {sgd: {lr: 0.4}}, lr: {a: 0.5}, dtype: float64}\n"
    )
    (plan,) = plan_stages(program, spec.train, Findings())
    data = dataset(gain_series(150), train=[70], val=[40])
    found = stage_data(plan, data, Findings())
    assert found is not None
    for make in (NativeEngine, TorchEngine):
        moved: list[np.ndarray] = []
        for factor in (1.0, 0.25):
            begin = initial_weights(program)
            engine = make(plan, data.series, begin, None, None)
            engine.begin_epoch(0, factor)
            engine.train_batches(found.train, 999)
            after = engine.weights()
            moved.append(np.array([float(after[name] - begin[name]) for name in ("a", "b")]))
        np.testing.assert_allclose(moved[1], 0.25 * moved[0], rtol=1e-9)

"""`msnn.stage_loss`: people's own training loops in torch, along the gradient of a kernel."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from msnn.training.records.progress import EpochEnd
from msnn.training.stage_loss_module import StageLoss, stage_loss
from msnn.training.train import TrainingOptions, train
from spec_schema.diagnostics.diagnostic import SpecError
from tests.conditions import require_tool
from tests.training.cases import dataset, gain, gain_series
from tests.training.stages.test_schedules import Epochs

STAGE = (
    "batch: 16, dtype: float64, optimizer: {sgd: {lr: 0.5}},"
    " rollout: {horizon: 4, curriculum: {1: 2}}"
)


def opened(stage: str) -> StageLoss:
    program, spec = gain(f"  - {{epochs: 3, {stage}}}\n")
    data = dataset(gain_series(150), train=[70], val=[40])
    return stage_loss(program, data, spec.train, 0, None)


def looped(loss: StageLoss, optimizer: torch.optim.Optimizer, epochs: int) -> list[float]:
    """The monitor after each epoch."""
    found: list[float] = []
    for epoch in range(epochs):
        for batch in loss.batches(epoch):
            optimizer.zero_grad()
            loss(batch).backward()
            optimizer.step()
        found.append(loss.monitor())
    return found


@pytest.mark.parametrize("engine", ["native", "torch"])
def test_a_loop_does_what_the_stage_does(engine: str) -> None:
    require_tool("gcc", install="apt install gcc")
    loss = opened(f"{STAGE}, engine: {engine}")
    found = looped(loss, torch.optim.SGD(loss.parameters(), lr=0.5), 3)
    program, spec = gain(f"  - {{epochs: 3, {STAGE}, engine: torch}}\n")
    heard = Epochs()
    data = dataset(gain_series(150), train=[70], val=[40])
    train(program, data, spec.train, TrainingOptions(runs=None), heard)
    events: list[EpochEnd] = heard.events
    assert found == pytest.approx([event.monitor for event in events], rel=1e-9)


def test_any_optimiser_of_torch_steps_along_the_kernel() -> None:
    require_tool("gcc", install="apt install gcc")
    losses = [opened(f"{STAGE}, engine: {engine}") for engine in ("native", "torch")]
    native, other = (
        looped(loss, torch.optim.RAdam(loss.parameters(), lr=0.05), 3) for loss in losses
    )
    assert native == pytest.approx(other, rel=1e-9)
    for name, weight in losses[1].weights().items():
        np.testing.assert_allclose(losses[0].weights()[name], weight, rtol=1e-9)


def test_gradients_pass_through_what_is_done_with_the_loss() -> None:
    require_tool("gcc", install="apt install gcc")
    gradients: list[list[float]] = []
    for engine in ("native", "torch"):
        loss = opened(f"{STAGE}, engine: {engine}")
        batch = next(loss.batches(0))
        (3.0 * loss(batch).sqrt()).backward()
        found = [value.grad for value in loss.parameters()]
        gradients.append([value.item() for value in found if value is not None])
        assert loss.losses["x_next"] == pytest.approx(loss(batch).item(), rel=1e-12)
    assert len(gradients[0]) == 2
    assert gradients[0] == pytest.approx(gradients[1], rel=1e-9)


def test_frozen_parameters_have_no_gradient_and_keep_every_bit() -> None:
    loss = opened(f"{STAGE}, freeze: b, engine: torch")
    before = loss.weights()
    looped(loss, torch.optim.SGD(loss.parameters(), lr=0.5), 1)
    assert loss.weights()["b"] == before["b"]
    assert loss.weights()["a"] != before["a"]


def test_what_is_wrong_with_the_stage_is_said() -> None:
    with pytest.raises(SpecError, match="fits no learnable parameter"):
        opened("freeze: aa")

"""Every optimiser that a spec can name learns, on the kernels and in torch."""

from __future__ import annotations

import pytest

from msnn.training.train import TrainingOptions, train
from spec_schema.sections.optimizers import Optimizer
from tests.conditions import require_tool
from tests.training.cases import dataset, gain, gain_series
from tests.training.stages.test_schedules import Epochs

OWN = [kind for kind in Optimizer.known_keys() if kind != "torch"]


@pytest.mark.parametrize("kind", OWN)
@pytest.mark.parametrize("engine", ["native", "torch"])
def test_it_learns(kind: str, engine: str) -> None:
    """docs/language.md, Training (R12)."""
    require_tool("gcc", install="apt install gcc")
    stage = f"  - {{epochs: 5, dtype: float64, optimizer: {kind}, engine: {engine}}}\n"
    program, spec = gain(stage)
    data = dataset(gain_series(150), train=[70], val=[40])
    heard = Epochs()
    train(program, data, spec.train, TrainingOptions(runs=None), heard)
    totals = [event.total for event in heard.events]
    assert totals[-1] < totals[0], totals

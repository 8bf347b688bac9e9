"""`optimizer: {torch: NAME}`: any optimiser of torch, along a kernel's gradient or torch's own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from msnn.training.torch_optimizers import torch_optimizer_names
from msnn.training.train import (
    TrainingInterruptedError,
    TrainingOptions,
    TrainingResult,
    train,
)
from spec_schema.diagnostics import SpecError
from tests.conditions import require_tool
from tests.training.cases import dataset, gain, gain_series
from tests.training.test_interruption import Interrupting
from tests.training.test_schedules import Epochs

NAMES = [name for name in torch_optimizer_names() if name != "Muon"]


def run(
    stage: str, heard: Epochs | Interrupting | None = None, options: TrainingOptions | None = None
) -> TrainingResult:
    program, spec = gain(f"  - {{batch: 16, dtype: float64, {stage}}}\n")
    data = dataset(gain_series(150), train=[70], val=[40])
    return train(program, data, spec.train, options or TrainingOptions(runs=None), heard)


def test_the_names_are_those_of_torch() -> None:
    assert {"RAdam", "NAdam", "Adagrad", "RMSprop", "Rprop"} <= set(NAMES)
    assert not {"LBFGS", "SparseAdam", "Optimizer", "lr_scheduler"} & set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_kernels_and_torch_train_alike(name: str) -> None:
    require_tool("gcc", install="apt install gcc")
    heard = [Epochs(), Epochs()]
    for engine, each in zip(("native", "torch"), heard, strict=True):
        run(f"epochs: 4, optimizer: {{torch: {name}}}, engine: {engine}", each)
    native, torch = ([event.total for event in each.events] for each in heard)
    assert native == pytest.approx(torch, rel=1e-9)
    assert native[-1] < native[0]


def test_options_schedule_factors_and_decay_reach_the_optimiser() -> None:
    heard = Epochs()
    result = run(
        "epochs: 3, weight_decay: 0.01, lr: {b: 0}, schedule: {exponential: {factor: 0.5}},"
        " optimizer: {torch: {name: RAdam, options: {lr: 0.1, betas: [0.8, 0.9]}}}",
        heard,
    )
    assert [event.lr for event in heard.events] == [0.1, 0.05, 0.025]
    assert result.weights["b"] == 0.0
    other = run(
        "epochs: 3, weight_decay: 0.01, lr: {b: 0}, schedule: {exponential: {factor: 0.5}},"
        " optimizer: {torch: {name: RAdam, options: {lr: 0.1}}}"
    )
    assert other.weights["a"] != result.weights["a"]


@pytest.mark.parametrize("name", ["NAdam", "ASGD"])
def test_it_resumes_bit_for_bit(name: str, tmp_path: Path) -> None:
    stage = f"epochs: 5, optimizer: {{torch: {name}}}"
    undisturbed = run(stage)
    with pytest.raises(TrainingInterruptedError):
        run(stage, Interrupting("stage_1", 2), TrainingOptions(runs=tmp_path))
    resumed = run(stage, None, TrainingOptions(runs=tmp_path, resume=True))
    for weight, value in undisturbed.weights.items():
        np.testing.assert_array_equal(resumed.weights[weight], value)


@pytest.mark.parametrize(
    ("optimizer", "code", "message"),
    [
        ("RAdm", "E0942", "`RAdm` is no optimiser"),
        ("Optimizer", "E0942", "`Optimizer` is no optimiser"),
        ("lr_scheduler", "E0942", "`lr_scheduler` is no optimiser"),
        ("LBFGS", "E0942", "`LBFGS` is no optimiser"),
        ("{name: RAdam, options: {beta: 0.9}}", "E0943", "`beta` is no option of RAdam"),
        ("{name: RAdam, options: {weight_decay: 1}}", "E0943", "`weight_decay` is no option"),
        ("{name: RAdam, options: {lr: -1}}", "E0945", "Invalid learning rate: -1"),
        ("{name: RAdam, options: {lr: fast}}", "E0945", "torch refuses RAdam"),
        ("{name: RAdam, options: {betas: [0.9]}}", "E0945", "torch refuses RAdam"),
        ("Muon", "E0945", "2D"),
    ],
)
def test_what_torch_would_refuse_is_said_before_anything_runs(
    optimizer: str, code: str, message: str
) -> None:
    with pytest.raises(SpecError) as caught:
        run(f"optimizer: {{torch: {optimizer}}}")
    (found,) = caught.value.diagnostics
    assert found.code == code
    assert message in found.message


def test_weight_decay_of_an_optimiser_that_has_none() -> None:
    with pytest.raises(SpecError) as caught:
        run("weight_decay: 0.1, optimizer: {torch: Rprop}")
    assert [found.code for found in caught.value.diagnostics] == ["E0944"]

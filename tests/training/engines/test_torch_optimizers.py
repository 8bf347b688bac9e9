"""`optimizer: {torch: NAME}`: any optimiser of torch, along a kernel's gradient or torch's own."""

from __future__ import annotations

import inspect
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from msnn.training.engines.torch.torch_optimizers import torch_optimizer_names
from msnn.training.plans.torch_optimizer_options import TORCH_OPTIMIZERS, NumberLimits, fits
from msnn.training.records.training_options import TrainingOptions
from msnn.training.train import train
from msnn.training.training_result import TrainingInterruptedError, TrainingResult
from spec_schema.diagnostics.diagnostic import SpecError
from tests.conditions import require_tool
from tests.training.cases import dataset, gain, gain_series
from tests.training.records.test_interruption import Interrupting
from tests.training.stages.test_schedules import Epochs

NAMES = [name for name in torch_optimizer_names() if name != "Muon"]


def run(
    stage: str, heard: Epochs | Interrupting | None = None, options: TrainingOptions | None = None
) -> TrainingResult:
    program, spec = gain(f"  - {{batch: 16, dtype: float64, {stage}}}\n")
    data = dataset(gain_series(150), train=[70], val=[40])
    return train(program, data, spec.train, options or TrainingOptions(runs=None), heard)


_NOT_OF_A_SPEC = {
    "params",
    "weight_decay",
    "maximize",
    "foreach",
    "fused",
    "capturable",
    "differentiable",
}
"""Arguments for which the stage has its own key, or that an engine decides."""
_VALUES = (-1, 0, 0.5, 1, 1.5, 100, 3.5, True, None, "fast", (0.5, 0.5), (0.5, 1.5), (0.5,))
_TOLERATED = (True, None, "fast", 0, 1)
"""Torch asks of switches only whether they are true, takes `true` for a number, and so on."""


def torch_signatures() -> dict[str, dict[str, inspect.Parameter]]:
    """The arguments of all optimisers of the installed torch that step along dense gradients."""
    found = {name: kind for name, kind in vars(torch.optim).items() if inspect.isclass(kind)}
    return {
        name: dict(inspect.signature(kind).parameters)
        for name, kind in found.items()
        if issubclass(kind, torch.optim.Optimizer)
        and name not in ("Optimizer", "LBFGS", "SparseAdam")
    }


def test_the_table_has_the_optimisers_and_options_of_torch() -> None:
    signatures = torch_signatures()
    assert {name: set(rule.options) for name, rule in TORCH_OPTIMIZERS.items()} == {
        name: set(arguments) - _NOT_OF_A_SPEC for name, arguments in signatures.items()
    }
    assert {name: rule.lr for name, rule in TORCH_OPTIMIZERS.items()} == {
        name: arguments["lr"].default for name, arguments in signatures.items()
    }
    for name, rule in TORCH_OPTIMIZERS.items():
        assert rule.has_weight_decay == ("weight_decay" in signatures[name])


def torch_takes(name: str, option: str, value: Any) -> bool:
    """Whether a matrix can be moved by the optimiser with this option."""
    matrix = torch.ones((2, 2), requires_grad=True)
    matrix.grad = torch.ones_like(matrix)
    settings: dict[str, Any] = {"momentum": 0.9} if name == "SGD" else {}
    try:
        optimizer = getattr(torch.optim, name)([matrix], **settings | {option: value})
        optimizer.step()
        optimizer.step()
    except (TypeError, ValueError, RuntimeError, IndexError, ZeroDivisionError):
        return False
    return True


@pytest.mark.parametrize(
    ("name", "option"),
    [(name, option) for name, rule in TORCH_OPTIMIZERS.items() for option in rule.options],
)
def test_the_table_takes_the_values_that_torch_takes(name: str, option: str) -> None:
    rule = TORCH_OPTIMIZERS[name].options[option]
    default = torch_signatures()[name][option].default
    assert fits(default, rule) or default is None
    for value in _VALUES:
        if fits(value, rule):
            assert torch_takes(name, option, value), value
        elif isinstance(rule, NumberLimits) and value not in _TOLERATED:
            assert not torch_takes(name, option, value), value


def test_check_does_not_import_torch(tmp_path: Path) -> None:
    spec = tmp_path / "plant.yaml"
    spec.write_text(
        "msnn: 1\nname: plant\nsample_time: 1 s\ninputs: {u: 1}\nparameters: {k: 2}\n"
        "outputs: {y: {expr: k * u, predicts: 'u[t+1]'}}\n"
        "data: {source: {train: a.csv}}\ntrain: [{optimizer: {torch: RAdam}}]\n"
    )
    script = (
        "import sys; from msnn.cli.application import run; "
        "sys.exit(run(['check', sys.argv[1]]) or 2 * ('torch' in sys.modules))"
    )
    subprocess.run([sys.executable, "-c", script, spec], check=True)


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
        ("{name: RAdam, options: {lr: -1}}", "E0945", "`lr` is a number at least 0"),
        ("{name: RAdam, options: {lr: fast}}", "E0945", "torch refuses RAdam"),
        ("{name: RAdam, options: {betas: [0.9]}}", "E0945", "at least 0 and below 1"),
        ("{name: SGD, options: {nesterov: true}}", "E0945", "Nesterov momentum requires"),
        ("Muon", "E0945", "it trains matrices, and `a` is none"),
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

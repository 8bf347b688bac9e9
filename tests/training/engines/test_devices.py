"""Training on a device: the same losses where it is there, a clear word where it is not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from compiler.ir.program import Role
from msnn.errors.failures import MissingExtraError
from msnn.training.engines.devices import CPU, Device, find_device, on_device
from msnn.training.engines.torch.torch_optimizers import placed_like
from msnn.training.plans.stage_plan import StagePlan, plan_stages
from msnn.training.records.run_record import stage_record
from msnn.training.records.training_options import TrainingOptions
from msnn.training.stage_loss_module import stage_loss
from msnn.training.train import train
from msnn.training.training_result import TrainingInterruptedError, TrainingResult
from spec_schema.diagnostics.diagnostic import Findings, SpecError
from tests.native.test_kernel import MODELS, log_of
from tests.training.cases import compiled, dataset, gain, gain_series
from tests.training.engines.pretended_card import PretendedCard, WrongDeviceError
from tests.training.engines.test_dropout import NET
from tests.training.records.test_interruption import Interrupting

CARD = Device("cuda", for_all=True)
ENGINES = "  - {engine: auto}\n  - {engine: native}\n  - {engine: torch}\n"
COMMON = "epochs: 3, batch: 16, rollout: 4, dtype: float64, engine: torch"
TARGET = """
inputs: {u: m}
targets: {y: m}
parameters: {a: 0.5}
outputs: {z: {expr: a*u, predicts: "y[t]"}}
"""
STAGES = {
    "adam": f"  - {{{COMMON}, clip: 0.1, weight_decay: 0.01}}\n",
    "sgd": f"  - {{{COMMON}, optimizer: {{sgd: {{lr: 0.01, momentum: 0.9}}}}, lr: {{a: 0.5}}}}\n",
    "starts": f"  - {{{COMMON}, starts: 2, optimizer: {{adamw: {{lr: 0.01}}}}}}\n",
    "lbfgs": "  - {epochs: 3, rollout: 4, dtype: float64, engine: torch,"
    " optimizer: {lbfgs: {iterations: 3}}}\n",
    "RAdam": "  - {epochs: 3, rollout: record, dtype: float64, engine: torch,"
    " optimizer: {torch: RAdam}}\n",
    "levenberg_marquardt": "  - {epochs: 3, rollout: 4, engine: torch,"
    " optimizer: {levenberg_marquardt: {}}}\n",
}

ROLLOUTS = {**MODELS, "dropout": (NET, ("x",)), "target": (TARGET, ())}
NO_SQUARES = ("joints", "classes")


def run(
    stages: str, options: TrainingOptions, progress: Interrupting | None = None
) -> TrainingResult:
    program, spec = gain(stages)
    data = dataset(gain_series(150), train=[70], val=[40])
    return train(program, data, spec.train, options, progress)


def plans(stages: str) -> list[StagePlan]:
    program, spec = gain(stages)
    return plan_stages(program, spec.train, Findings())


def devices(found: list[StagePlan]) -> list[tuple[str, str]]:
    return [(plan.engine, plan.device) for plan in found]


def has_cards(monkeypatch: pytest.MonkeyPatch, count: int, built_for: str | None = "12.8") -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: count > 0)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: count)
    monkeypatch.setattr(torch.version, "cuda", built_for)


def test_devices_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    has_cards(monkeypatch, 2)
    assert find_device("cpu") == CPU == TrainingOptions().device
    assert find_device("cuda") == CARD
    assert find_device("cuda:1") == Device("cuda:1", for_all=True)
    assert find_device("auto") == Device("cuda", for_all=False)
    for name in ("cpu", "cuda", "cuda:1", "auto"):
        assert find_device(name).name == name
    has_cards(monkeypatch, 0)
    assert find_device("auto") == CPU


@pytest.mark.parametrize("name", ["gpu", "cuda1", "cuda:", "cuda:-1", "cuda:01", "CPU", "", "mps"])
def test_other_names_are_no_devices(name: str) -> None:
    with pytest.raises(SpecError) as caught:
        find_device(name)
    (fault,) = caught.value.diagnostics
    assert fault.code == "E0971"
    assert fault.help is not None
    assert "cuda:N" in fault.help


def test_cards_that_are_there_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    has_cards(monkeypatch, 2)
    with pytest.raises(SpecError) as caught:
        find_device("cuda:2")
    (fault,) = caught.value.diagnostics
    assert fault.code == "E0972"
    assert fault.help is not None
    assert "cuda:0, cuda:1" in fault.help


@pytest.mark.parametrize(
    ("built_for", "remedy"), [(None, "built for the CPU alone"), ("12.8", "nvidia-smi")]
)
def test_without_cuda_it_is_said_what_is_missing(
    built_for: str | None, remedy: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    has_cards(monkeypatch, 0, built_for)
    with pytest.raises(MissingExtraError, match="CUDA that torch can use") as caught:
        find_device("cuda")
    assert caught.value.diagnostic.help is not None
    assert remedy in caught.value.diagnostic.help


def test_auto_takes_the_card_for_stages_on_torch() -> None:
    found = devices(on_device(plans(ENGINES), Device("cuda", for_all=False), Findings()))
    assert found == [("auto", "cpu"), ("native", "cpu"), ("torch", "cuda")]
    assert {plan.device for plan in on_device(plans(ENGINES), CPU, Findings())} == {"cpu"}


def test_a_card_is_for_every_stage_that_does_not_insist_on_kernels() -> None:
    findings = Findings()
    found = devices(on_device(plans("  - {}\n  - {engine: torch}\n"), CARD, findings))
    assert found == [("torch", "cuda")] * 2
    on_device(plans(ENGINES), CARD, findings)
    (fault,) = findings.in_order
    assert fault.code == "E0970"
    assert fault.span is not None


def test_the_device_is_part_of_a_run() -> None:
    (plan,) = on_device(plans(STAGES["adam"]), CARD, Findings())
    assert stage_record(plan)["device"] == "cuda"


def test_a_loaded_state_goes_where_the_optimiser_has_its_parts() -> None:
    """Adam counts steps on the CPU wherever its moments are; `meta` stands for another device."""
    loaded = {"step": torch.zeros(()), "past": [torch.zeros(2, device="meta")], "rate": 1.0}
    kept = {"step": torch.ones(()), "past": [torch.ones(2)], "rate": 0.5}
    found = placed_like(kept, loaded)
    assert (found["step"].device.type, found["step"].item()) == ("cpu", 1.0)
    assert found["past"][0].device.type == "meta"
    assert found["rate"] == 0.5


def test_the_pretended_card_refuses_what_cuda_refuses() -> None:
    with PretendedCard():
        here, there = torch.ones(3), torch.ones(3, device="cuda")
        assert (there * 2).device.type == "cuda"
        assert (there + torch.ones(())).cpu().device.type == "cpu"
        with pytest.raises(WrongDeviceError):
            torch.add(here, there)
        with pytest.raises(WrongDeviceError):
            there.numpy()
        with pytest.raises(WrongDeviceError):
            torch.cat([here, there[1:]])


@pytest.mark.parametrize("kind", STAGES)
def test_every_tensor_of_a_stage_is_on_its_device(kind: str) -> None:
    on_cpu = run(STAGES[kind], TrainingOptions(runs=None))
    with PretendedCard() as card:
        found = run(STAGES[kind], TrainingOptions(runs=None, device=CARD))
    assert card.on_card > 100
    for name, value in on_cpu.weights.items():
        np.testing.assert_array_equal(found.weights[name], value)


@pytest.mark.parametrize(
    ("model", "optimizer"),
    [
        *((model, "adam") for model in ROLLOUTS),
        *((model, "levenberg_marquardt") for model in ROLLOUTS if model not in NO_SQUARES),
    ],
)
def test_every_tensor_of_a_model_is_on_its_device(model: str, optimizer: str) -> None:
    text, closed = ROLLOUTS[model]
    rollout = f"{{horizon: 4, skip: 1, close: [{', '.join(closed)}]}}"
    stage = f"{{epochs: 1, rollout: {rollout}, optimizer: {{{optimizer}: {{}}}}, engine: torch}}"
    time = "" if "sample_time" in text else "sample_time: 0.1 s\n"
    program, spec = compiled(f"msnn: 1\nname: test\n{time}{text}\ntrain:\n  - {stage}\n")
    log = log_of(program)
    for target in (signal for signal in program.signals if signal.role is Role.TARGET):
        log[target.name][40:43] = np.nan
    data = dataset(log, train=[50], val=[40])
    with PretendedCard() as card:
        train(program, data, spec.train, TrainingOptions(runs=None, device=CARD))
    assert card.on_card > 100


@pytest.mark.parametrize("kind", ["adam", "lbfgs"])
def test_a_run_on_a_card_goes_on_there(kind: str, tmp_path: Path) -> None:
    whole = run(STAGES[kind], TrainingOptions(runs=None))
    options = TrainingOptions(runs=tmp_path, device=CARD)
    with PretendedCard():
        with pytest.raises(TrainingInterruptedError):
            run(STAGES[kind], options, Interrupting("stage_1", 2))
        resumed = run(STAGES[kind], TrainingOptions(runs=tmp_path, device=CARD, resume=True))
    for name, value in whole.weights.items():
        np.testing.assert_array_equal(resumed.weights[name], value)
    with PretendedCard(), pytest.raises(TrainingInterruptedError):
        run(STAGES[kind], options, Interrupting("stage_1", 2))
    with pytest.raises(SpecError) as caught:
        run(STAGES[kind], TrainingOptions(runs=tmp_path, resume=True))
    (fault,) = caught.value.diagnostics
    assert any("device" in note for note in fault.notes)


def test_a_loss_for_own_loops_is_on_its_device() -> None:
    program, spec = gain("  - {rollout: 4}\n")
    data = dataset(gain_series(150), train=[70], val=[40])
    with PretendedCard() as card:
        loss = stage_loss(program, data, spec.train, 0, None, CARD)
        loss(next(loss.batches(0))).backward()
        loss.monitor()
    assert card.on_card > 100


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a graphics card with CUDA")
@pytest.mark.parametrize("kind", STAGES)
def test_cuda_trains_to_the_losses_of_the_cpu(kind: str) -> None:
    on_cpu = run(STAGES[kind], TrainingOptions(runs=None))
    on_cuda = run(STAGES[kind], TrainingOptions(runs=None, device=CARD))
    # float64, but sums in another order
    assert on_cuda.stages[0].best_value == pytest.approx(on_cpu.stages[0].best_value, rel=1e-6)
    for name, value in on_cpu.weights.items():
        assert on_cuda.weights[name] == pytest.approx(value, rel=1e-6)

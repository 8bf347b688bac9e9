"""A mistake of msnn's own in a kernel costs nobody a training: it warns and goes on without."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from inspect import unwrap
from pathlib import Path

import numpy as np
import pytest

from backends.c_language.literals import Dtype
from backends.native import kernel as kernel_module
from backends.native import sensitivity_kernel as sensitivity_module
from backends.native.kernel_source import KernelSource
from backends.native.sensitivity_kernel import SensitivitySource
from compiler.differentiation.sensitivities import Sensitivities
from compiler.differentiation.training_step import TrainingStep
from msnn.simulation.engines.kernel_check import WrongKernelError
from msnn.training.records.training_options import TrainingOptions
from msnn.training.stage_loss_module import stage_loss
from msnn.training.train import train
from msnn.training.training_result import TrainingInterruptedError, TrainingResult
from spec_schema.diagnostics.diagnostic import SpecError
from tests.conditions import require_tool
from tests.training.cases import compiled, dataset, gain, gain_series
from tests.training.records.test_interruption import Interrupting
from tests.training.starts.test_starts import NET, Heard, data, run

SourceOf = Callable[..., KernelSource]
STAGES = "  - {{epochs: 4, batch: 16{more}}}\n"
RIGHT, WRONG = "all->slopes[i] += slopes[i];", "all->slopes[i] += slopes[i] * (real)0.9;"


@pytest.fixture(autouse=True)
def _compiler() -> None:
    require_tool("gcc", install="apt install gcc")


@pytest.fixture(autouse=True)
def _written_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """No source that was kept stands in for one that a test spoils, or outlives its test."""
    for name in ("_source", "_source_of_losses"):
        monkeypatch.setattr(kernel_module, name, unwrap(vars(kernel_module)[name]))


def spoiled(*precisions: str) -> SourceOf:
    """Sources of kernels whose gradient is a tenth too small in these precisions."""
    right = kernel_module.kernel_source

    def source(
        step: TrainingStep, dtype: Dtype, *, reproducible: bool, lbfgs: bool
    ) -> KernelSource:
        made = right(step, dtype, reproducible=reproducible, lbfgs=lbfgs)
        assert RIGHT in made.text
        text = made.text.replace(RIGHT, WRONG) if dtype in precisions else made.text
        return replace(made, text=text)

    return source


def not_written(
    step: TrainingStep, dtype: Dtype, *, reproducible: bool, lbfgs: bool
) -> KernelSource:
    raise KeyError("w")


def no_c(step: TrainingStep, dtype: Dtype, *, reproducible: bool, lbfgs: bool) -> KernelSource:
    return KernelSource(text="this is no C", signals=(), parameters=(), losses=())


def trained(
    more: str, options: TrainingOptions | None = None, heard: Heard | None = None
) -> TrainingResult:
    program, spec = gain(STAGES.format(more=more))
    series = dataset(gain_series(150), train=[70], val=[40])
    return train(program, series, spec.train, options or TrainingOptions(runs=None), heard)


def assert_same(found: TrainingResult, expected: TrainingResult) -> None:
    for name, value in expected.weights.items():
        np.testing.assert_array_equal(found.weights[name], value)


CASES: dict[str, tuple[SourceOf, str, list[str]]] = {
    "wrong in float32": (spoiled("float32"), ", dtype: float64", ["W0950"]),
    "wrong in both": (spoiled("float32", "float64"), ", engine: torch", ["W0950", "W0950"]),
    "not written": (not_written, ", engine: torch", ["W0951"]),
    "refused by the compiler": (no_c, ", engine: torch", ["W0951"]),
}


@pytest.mark.usefixtures("goes_on_without_kernels")
@pytest.mark.parametrize("case", CASES)
def test_training_goes_on_and_is_kept(
    case: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    source, same_as, codes = CASES[case]
    expected = trained(same_as)
    monkeypatch.setattr(kernel_module, "kernel_source", source)
    heard = Heard()
    found = trained("", TrainingOptions(runs=tmp_path), heard)
    assert_same(found, expected)
    ours = [w for w in heard.warnings if w.code in ("W0950", "W0951")]
    assert [warning.code for warning in ours] == codes
    assert found.folder is not None
    assert (tmp_path / "gain" / "latest").resolve() == found.folder.resolve()
    record = json.loads((found.folder / "run.json").read_text())
    # what was planned promised the same bits everywhere
    assert not record["bits"]["reproducible"]
    (reason,) = record["bits"]["depends_on"].values()
    assert ("torch" in reason) == ("torch" in same_as)
    assert all(any(w.message in line for line in record["end"]["warnings"]) for w in ours)
    if codes[0] == "W0950":
        assert "where rounding explains" in ours[0].message
        assert "goes on in float64: kernel " in ours[0].message


@pytest.mark.usefixtures("goes_on_without_kernels")
@pytest.mark.parametrize("precisions", [("float32",), ("float32", "float64")])
def test_such_a_run_resumes_bit_for_bit(
    precisions: tuple[str, ...], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(kernel_module, "kernel_source", spoiled(*precisions))
    undisturbed = trained("")
    program, spec = gain(STAGES.format(more=""))
    series = dataset(gain_series(150), train=[70], val=[40])
    options = TrainingOptions(runs=tmp_path)
    with pytest.raises(TrainingInterruptedError):
        train(program, series, spec.train, options, Interrupting("stage_1", 2))
    assert_same(trained("", TrainingOptions(runs=tmp_path, resume=True)), undisturbed)


@pytest.mark.usefixtures("goes_on_without_kernels")
def test_a_kernel_that_failed_is_not_tried_in_the_next_start(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made: list[str] = []
    source = spoiled("float32")

    def counted(
        step: TrainingStep, dtype: Dtype, *, reproducible: bool, lbfgs: bool
    ) -> KernelSource:
        made.append(dtype)
        return source(step, dtype, reproducible=reproducible, lbfgs=lbfgs)

    monkeypatch.setattr(kernel_module, "kernel_source", counted)
    heard = Heard()
    run(compiled(NET + "  - {epochs: 2, starts: 3}\n"), heard, series=data())
    assert made == ["float32", "float64", "float64", "float64"]
    # two epochs move little: W0937
    assert [w.code for w in heard.warnings if w.code != "W0937"] == ["W0950"]


def spoiled_sensitivities(found: Sensitivities) -> SensitivitySource:
    made = _SENSITIVITIES(found)
    right, wrong = "fused(row[i + a], row[j + b],", "fused(row[i + a] * 1.01, row[j + b],"
    assert right in made.source.text
    return replace(made, source=replace(made.source, text=made.source.text.replace(right, wrong)))


_SENSITIVITIES = sensitivity_module.sensitivity_source


@pytest.mark.usefixtures("goes_on_without_kernels")
def test_second_order_training_goes_on_on_torch(monkeypatch: pytest.MonkeyPatch) -> None:
    expected = second_order("engine: torch")
    monkeypatch.setattr(sensitivity_module, "sensitivity_source", spoiled_sensitivities)
    heard = Heard()
    assert_same(second_order("engine: auto", heard), expected)
    assert [w.code for w in heard.warnings] == ["W0950"]


@pytest.mark.usefixtures("goes_on_without_kernels")
@pytest.mark.parametrize(
    ("optimizer", "writes", "times"),
    [("levenberg_marquardt", "losses_source", 1), ("{torch: Rprop}", "kernel_source", 2)],
)
def test_whatever_steps_outside_of_a_kernel_goes_on_on_torch(
    optimizer: str, writes: str, times: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Levenberg-Marquardt judges its steps by a kernel of the losses alone."""
    expected = stepping_by(optimizer, "engine: torch")
    right = vars(kernel_module)[writes]

    def wrong(*args: object, **options: object) -> KernelSource:
        made = right(*args, **options)
        text = made.text.replace("sums[l] += (double)", "sums[l] += 1.01 * (double)")
        assert text != made.text
        return replace(made, text=text)

    monkeypatch.setattr(kernel_module, writes, wrong)
    heard = Heard()
    assert_same(stepping_by(optimizer, "engine: auto", heard), expected)
    assert [w.code for w in heard.warnings if w.code.startswith("W095")] == ["W0950"] * times


def test_slopes_too_large_for_a_kernel_are_a_limit_and_no_mistake(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    expected = second_order("engine: torch")
    monkeypatch.setattr(sensitivity_module, "LARGEST_STACK", -1)  # a step of the model needs none
    heard = Heard()
    assert_same(second_order("engine: auto", heard), expected)
    (said,) = heard.warnings
    assert said.code == "W0951"
    assert "goes on with torch: its kernel is too large (a step needs " in said.message
    assert said.help is not None
    assert "report" not in said.help
    with pytest.raises(SpecError, match="MiB of stack") as caught:
        second_order("engine: native")
    assert [fault.code for fault in caught.value.diagnostics] == ["E0922"]


def second_order(engine: str, heard: Heard | None = None) -> TrainingResult:
    return stepping_by("levenberg_marquardt", engine, heard)


def stepping_by(optimizer: str, engine: str, heard: Heard | None = None) -> TrainingResult:
    program, spec = gain(f"  - {{epochs: 4, optimizer: {optimizer}, {engine}}}\n")
    series = dataset(gain_series(150), train=[70], val=[40])
    return train(program, series, spec.train, TrainingOptions(runs=None), heard)


@pytest.mark.usefixtures("goes_on_without_kernels")
def test_standard_errors_go_on_on_torch(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    expected = trained("", TrainingOptions(runs=tmp_path / "right")).standard_errors
    monkeypatch.setattr(sensitivity_module, "sensitivity_source", spoiled_sensitivities)
    result = trained("", TrainingOptions(runs=tmp_path / "wrong"))
    found = result.standard_errors
    assert found is not None
    assert expected is not None
    assert [note.code for note in found.notes] == ["W0950"]
    for name, value in expected.errors.items():
        np.testing.assert_allclose(found.errors[name], value, rtol=1e-9)
    assert result.folder is not None
    record = json.loads((result.folder / "run.json").read_text())
    assert any("W0950" in line for line in record["end"]["warnings"])


@pytest.mark.usefixtures("goes_on_without_kernels")
def test_a_loop_of_ones_own_goes_on_in_torch(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel_module, "kernel_source", spoiled("float32", "float64"))
    program, spec = gain(STAGES.format(more=""))
    series = dataset(gain_series(150), train=[70], val=[40])
    loss = stage_loss(program, series, spec.train, 0, None)
    assert [note.code for note in loss.notes] == ["W0950"]
    loss(next(loss.batches(0))).backward()


@pytest.mark.usefixtures("goes_on_without_kernels")
def test_who_asks_for_kernels_hears_that_there_are_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel_module, "kernel_source", not_written)
    with pytest.raises(SpecError, match="KeyError: 'w'") as caught:
        trained(", engine: native")
    assert [d.code for d in caught.value.diagnostics] == ["E0922"]


def test_the_suite_fails_where_msnn_would_go_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel_module, "kernel_source", spoiled("float32"))
    with pytest.raises(WrongKernelError):
        trained("")
    monkeypatch.setattr(kernel_module, "kernel_source", not_written)
    with pytest.raises(KeyError):
        trained("")

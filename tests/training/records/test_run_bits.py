"""What `run.json` says of the bits of the weights, and what cannot promise them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from backends.native import compile_kernel
from msnn.training.train import TrainingOptions, train
from spec_schema.diagnostics.diagnostic import SpecError
from tests.conditions import require_tool
from tests.training.cases import compiled, dataset, gain, gain_series

FITTED = """
msnn: 1
name: fitted
sample_time: 1 s
inputs: {u: m, x: m}
layers: {h: {iir: {num: 2, den: 2, fit: "x[t+1]"}}}
outputs: {x_next: {expr: h(u), predicts: "x[t+1]"}}
train: [{name: one, epochs: 1}]
"""


def bits(stages: str, folder: Path) -> dict[str, Any]:
    program, spec = gain(stages)
    data = dataset(gain_series(50), train=[50])
    result = train(program, data, spec.train, TrainingOptions(runs=folder))
    assert result.folder is not None
    return json.loads((result.folder / "run.json").read_text(encoding="utf-8"))["bits"]


def test_a_run_says_what_made_its_kernels_and_what_its_bits_depend_on(tmp_path: Path) -> None:
    require_tool("gcc", install="apt install gcc")
    one = "  - {name: one, epochs: 1}\n"
    found = bits(one, tmp_path)
    assert found["kernels"]["compiler"]
    assert "-ffp-contract=off" in found["kernels"]["flags"]
    fuses = {"FMA", "AArch64"} & set(found["kernels"]["features"])
    assert found["reproducible"] is bool(fuses)
    assert set(found["depends_on"]) == (set() if fuses else {"one"})
    found = bits(
        "  - {name: one, epochs: 1, reproducible: true}\n"
        "  - {name: two, epochs: 1, engine: torch}\n"
        "  - {name: three, epochs: 1, optimizer: levenberg_marquardt}\n",
        tmp_path,
    )
    assert found["reproducible"] is False
    assert set(found["depends_on"]) == {"two", "three"}


def test_without_fma_bits_depend_on_the_processor_unless_the_stage_insists(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    require_tool("gcc", install="apt install gcc")
    monkeypatch.setattr(compile_kernel, "_FEATURES", {"__AVX2__": "AVX2"})
    stage = "  - {name: one, epochs: 1}\n"
    assert "no fused multiply-add" in bits(stage, tmp_path)["depends_on"]["one"]
    insists = stage.replace("epochs: 1", "epochs: 1, reproducible: true")
    assert bits(insists, tmp_path)["reproducible"] is True


@pytest.mark.parametrize(
    ("stage", "decides"),
    [
        ("{name: one, optimizer: {torch: NAdam}}", "torch and the processor"),
        ("{name: one, optimizer: levenberg_marquardt}", "LAPACK"),
    ],
)
def test_what_steps_outside_of_a_kernel_decides_the_bits(
    stage: str, decides: str, tmp_path: Path
) -> None:
    require_tool("gcc", install="apt install gcc")
    found = bits(f"  - {stage}\n", tmp_path)
    assert found["reproducible"] is False
    assert decides in found["depends_on"]["one"]


def test_without_a_compiler_torch_decides_the_bits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    found = bits("  - {name: one, epochs: 1}\n", tmp_path)
    assert found["kernels"] is None
    assert found["depends_on"] == {"one": "torch and the processor"}


def test_a_layer_that_is_fitted_depends_on_lapack(tmp_path: Path) -> None:
    require_tool("gcc", install="apt install gcc")
    program, spec = compiled(FITTED)
    result = train(
        program, dataset(gain_series(90), train=[90]), spec.train, TrainingOptions(runs=tmp_path)
    )
    assert result.folder is not None
    found = json.loads((result.folder / "run.json").read_text(encoding="utf-8"))["bits"]
    assert [*found["depends_on"]] == ["h"]
    assert "LAPACK" in found["depends_on"]["h"]


def test_lbfgs_of_a_kernel_keeps_the_promise(tmp_path: Path) -> None:
    require_tool("gcc", install="apt install gcc")
    stage = "  - {epochs: 1, reproducible: true, optimizer: lbfgs}\n"
    assert bits(stage, tmp_path)["reproducible"] is True


@pytest.mark.parametrize(
    "keys",
    [
        "optimizer: lbfgs, engine: torch",
        "optimizer: levenberg_marquardt",
        "optimizer: {torch: {name: NAdam}}",
        "engine: torch",
    ],
)
def test_a_stage_that_cannot_keep_the_promise_is_refused(keys: str) -> None:
    program, spec = gain(f"  - {{reproducible: true, {keys}}}\n")
    with pytest.raises(SpecError) as caught:
        train(program, dataset(gain_series(50), train=[50]), spec.train, TrainingOptions(runs=None))
    (found,) = [d for d in caught.value.diagnostics if d.severity == "error"]
    assert found.code == "E0988"
    assert found.span is not None

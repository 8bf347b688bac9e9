"""The reference model on a core without an FPU: bits, instructions, flash and MISRA."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from compiler.interpreter.interpreter import physical_weights
from compiler.ir.program import Program
from msnn.cli.application import run
from msnn.exports.export import write_export
from msnn.verification.proof_step import ARM_GCC, ARM_QEMU, CPPCHECK
from tests.conditions import miss
from tests.features.fixed_point.exported import fixed_model, gallery_text, planned


def test_a_step_is_short_and_small(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for tool in (ARM_GCC, ARM_QEMU, CPPCHECK):
        if not tool.is_there:
            miss(f"{tool.command} is not installed: apt-get install {tool.package}")
    plan = planned(fixed_model(tmp_path, gallery_text("reference"), "q15"))
    write_export(plan, _no_two_equal(plan.program), tmp_path / "c")
    capsys.readouterr()
    options = ["--targets", "m0", "--misra", "--format", "json"]
    code = run(["verify", str(tmp_path / "c"), *options])
    assert code == 0
    found = json.loads(capsys.readouterr().out)
    figures = [row for result in found["results"] for row in result["figures"]]
    assert len(figures) == 2
    for row in figures:
        assert row["instructions"][1] <= 600
        assert row["flash"] <= 1300


def _no_two_equal(program: Program) -> dict[str, Any]:
    """Trained weights: equal ones would let a compiler share their products."""
    random = np.random.default_rng(3)
    return {
        name: value + 0.01 * random.standard_normal(np.shape(value))
        for name, value in physical_weights(program, {}).items()
    }


@pytest.mark.parametrize(
    ("name", "dtype"), [("battery", "q31"), ("engine_map", "q15"), ("quarter_car", "q15")]
)
def test_misra(
    name: str,
    dtype: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if not CPPCHECK.is_there:
        miss(f"{CPPCHECK.command} is not installed: apt-get install {CPPCHECK.package}")
    plan = planned(fixed_model(tmp_path, gallery_text(name), dtype))
    write_export(plan, {}, tmp_path / "c")
    # builds and golden steps of the others are in test_bits, of which these levels are not part
    monkeypatch.setattr("msnn.verification.host_builds.LEVELS", ("-O3", "-Os"))
    targets = "host" if name == "quarter_car" else ""
    assert run(["verify", str(tmp_path / "c"), "--targets", targets, "--misra"]) == 0
    assert " 0 findings by the MISRA addon" in capsys.readouterr().out

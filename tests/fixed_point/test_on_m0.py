"""The reference model on a core without an FPU: bits, instructions and flash."""

import json
from pathlib import Path

import pytest

from msnn.cli.application import run
from msnn.exporting import write_export
from msnn.verification.tools import ARM_GCC, ARM_QEMU
from tests.conditions import miss
from tests.fixed_point.exported import fixed_model, gallery_text, planned


def test_a_step_is_short_and_small(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for tool in (ARM_GCC, ARM_QEMU):
        if not tool.is_there:
            miss(f"{tool.command} is not installed: apt-get install {tool.package}")
    plan = planned(fixed_model(tmp_path, gallery_text("reference"), "q15"))
    write_export(plan, {}, tmp_path / "c")
    capsys.readouterr()
    code = run(["verify", str(tmp_path / "c"), "--targets", "m0", "--format", "json"])
    assert code == 0
    found = json.loads(capsys.readouterr().out)
    figures = [row for result in found["results"] for row in result["figures"]]
    assert len(figures) == 2
    for row in figures:
        assert row["instructions"][1] <= 600
        assert row["flash"] <= 1300

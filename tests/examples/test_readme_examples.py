"""The program in the README of generated C runs, and every step of it is in order."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from msnn.exports.export import plan_exports, write_export
from msnn.model.load import load_model
from spec_schema.diagnostics.diagnostic import Findings
from tests.conditions import require_tool
from tests.examples.gallery import GALLERY, NAMES, spec_of


@pytest.mark.parametrize("name", NAMES)
def test_the_example_of_generated_c_begins_and_steps_with_status_0(
    name: str, tmp_path: Path
) -> None:
    require_tool("cc", "apt-get install gcc")
    model, findings = load_model(spec_of(GALLERY, name)), Findings()
    (plan,) = plan_exports(model, ["c"], findings)
    assert not findings.failed
    write_export(plan, {}, tmp_path)
    text = (tmp_path / "README.md").read_text(encoding="utf-8")
    (tmp_path / "main.c").write_text(text.split("```c\n")[1].split("```")[0], encoding="utf-8")
    command = next(line for line in text.splitlines() if line.startswith("    cc ")).split()
    subprocess.run([*command, "-Wall", "-Wextra", "-Werror"], cwd=tmp_path, check=True)
    said = subprocess.run([tmp_path / "a.out"], check=True, capture_output=True, text=True).stdout
    steps = [line for line in said.splitlines() if line.startswith("status")]
    assert [line.split()[1] for line in steps] == ["0"] * 10, said
    assert [line for line in said.splitlines() if line not in steps] in ([], ["reset 0"])

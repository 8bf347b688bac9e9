"""The arm's example: its specs are silent, and its friction is exported as C without the robot."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from msnn.cli.application import run
from msnn.model.load import load_model
from tests.conditions import require_tool

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "z1_friction"


@pytest.mark.parametrize("name", ["z1_friction", "bodies"])
def test_units_fit(name: str) -> None:
    assert load_model(EXAMPLE / f"{name}.msnn.yaml", strict_units=True).warnings == ()


def test_the_friction_compensator_is_c_without_the_robot(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    require_tool("gcc", install="apt-get install gcc")
    for file in [*EXAMPLE.glob("*.yaml"), *EXAMPLE.glob("*.urdf")]:
        shutil.copy(file, tmp_path)
    # of an arm that nobody has trained yet
    spec = tmp_path / "compensator.msnn.yaml"
    text = spec.read_text(encoding="utf-8")
    weights = "weights: runs/z1_friction/latest/weights.safetensors, "
    assert weights in text
    spec.write_text(text.replace(weights, ""), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    code = run(["export", str(spec), "--to", "c", "--check", "--format", "json"])
    said = json.loads(capsys.readouterr().out)
    assert code == 0, said
    (file,) = (tmp_path / "build").rglob("z1_friction.c")
    step = file.read_text(encoding="utf-8")
    assert "tau_f" in step
    assert "ddq" not in step

"""The steering example: a vehicle is learned, and a controller through it, frozen."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import onnx
import pytest

from msnn.cli.application import run
from tests.conditions import require_tool

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "steering"


def generated(folder: Path) -> dict[str, bytes]:
    """What the generator writes to a folder."""
    generator = [sys.executable, str(EXAMPLE / "generate_data.py"), "--out", str(folder)]
    subprocess.run(generator, check=True, capture_output=True)
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*.csv")}


def test_the_drives_are_the_same_every_time_and_understeer(tmp_path: Path) -> None:
    first = generated(tmp_path / "once")
    assert first == generated(tmp_path / "again")
    assert len(set(first.values())) == 16
    drive = np.loadtxt(tmp_path / "once" / "test" / "drive_01.csv", delimiter=",", skiprows=1)
    v, curvature, steering = drive[:, 0], drive[:, 2], drive[:, 3]
    # steering = gear · curvature · (wheelbase + understeer · v²), when turns are slow: by least
    # squares near the car's 2.7 m and 0.0032 rad s²/m
    terms = 15 * np.column_stack((curvature, curvature * v**2))
    base, understeer = np.linalg.lstsq(terms, steering, rcond=None)[0]
    assert base == pytest.approx(2.7, rel=0.1)
    assert understeer == pytest.approx(0.0032, rel=0.3)


def test_a_controller_is_trained_through_the_vehicle_and_exported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    require_tool("gcc", install="apt-get install gcc")
    for spec in EXAMPLE.glob("*.yaml"):
        shutil.copy(spec, tmp_path)
    generated(tmp_path / "data")
    monkeypatch.chdir(tmp_path)
    few = ["--set", "train.0.epochs=4"]
    assert run(["train", "vehicle.msnn.yaml", *few]) == 0
    assert run(["validate", "vehicle.msnn.yaml"]) in (0, 3)
    assert run(["train", "lateral.msnn.yaml", *few, "--set", "train.1.epochs=4"]) == 0
    capsys.readouterr()
    assert run(["validate", "lateral.msnn.yaml", "--format", "json"]) in (0, 3)
    curvature, steering = json.loads(capsys.readouterr().out)["metrics"]
    # bends of up to 0.02 1/m, steering of up to 1.5 rad
    assert curvature["value"] < 0.002
    assert steering["value"] < 0.2
    assert run(["export", "lateral.msnn.yaml", "--check", "--format", "json"]) == 0
    targets = json.loads(capsys.readouterr().out)["agreement"]["targets"]
    assert {target["target"]: target["bits"] for target in targets} == {"onnx": None, "c": 0}
    graph = onnx.load("build/export/onnx/lateral_controller.onnx").graph
    outputs = {value.name for value in graph.output}
    assert {"steer", "from_target", "from_past"} <= outputs
    assert "vehicle.rho_hat" not in outputs

"""Follows the published protocol on one recording, by `msnn train` and `msnn validate` alone."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from dataclasses import dataclass
from math import degrees
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
RECORDS = {
    "multisine": "sinal4_multiseno_malha_fechada.csv",
    "steps": "sinal2_degraus_malha_fechada.csv",
    "swept": "sinal3_swept_sine_malha_fechada.csv",
}
SPECS = {
    "textbook physics": HERE / "drone_physics.msnn.yaml",
    "with dry friction and drag": HERE / "drone_arm.msnn.yaml",
}
PUBLISHED = {
    "least squares on the physics": {"multisine": 2.160, "steps": 4.079, "swept": 3.178},
    "NARX": {"multisine": 2.162, "steps": 3.850, "swept": 4.061},
    "neural ODE, 16 units": {"multisine": 1.545, "steps": 4.003, "swept": 2.561},
    "neural ODE, 64×2": {"multisine": 2.512, "steps": 5.711, "swept": 2.102},
}
"""RMSE in degrees over blocks 2 and 4, from the README of the data."""


@dataclass(frozen=True, slots=True)
class Score:
    """RMSE in degrees of the free-run simulation over the blocks that were not used for
    training.
    """

    degrees: float
    rows: int
    training_seconds: float
    parameters: dict[str, float]


def score(spec: Path, record: Path, folder: Path) -> Score:
    """Trains a spec on blocks 1, 3, 5 of a record and scores it on 2 and 4, in an empty folder."""
    shutil.copy(spec, folder / spec.name)
    shutil.copy(record, folder / "record.csv")
    trained = _msnn(folder, "train", spec.name)
    (metric,) = _msnn(folder, "validate", spec.name)["metrics"]
    assert metric["unit"] == "rad"
    return Score(
        degrees(metric["value"]),
        metric["scored"],
        sum(stage["seconds"] for stage in trained["stages"]),
        {p["name"]: p["values"][0] for p in trained["parameters"]},
    )


def _msnn(folder: Path, verb: str, spec: str) -> dict[str, Any]:
    command = [sys.executable, "-m", "msnn", verb, spec, "--format", "json"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode not in (0, 3):
        raise RuntimeError(done.stderr)
    return json.loads(done.stdout)

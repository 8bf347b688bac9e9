"""Trains the specs of a folder with the msnn that runs this, and keeps what its runs compute.

    python tests/old_runs/keep.py FOLDER

The folder has the specs `friction`, `sled` and `folds`, as `version_1` has them, and their data. It
gets the runs, a compiled program with its weights, and what the reference interpreter computes with
each of them. Later versions must compute the same: `test_old_runs.py`.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

RUNS, EXPECTED, SIMULATED = "trained", "expected.json", "simulated.csv"
_PART, _WHOLE, _FOLDS = "friction", "sled", "folds"
_INTERPRETED = ("--data-root", ".", "--engine", "interpreter")
_MEASURE = ("of", "unit", "horizon", "data", "scored")


def validations(folder: Path) -> list[list[str]]:
    """The arguments that validate each run of the folder, and its compiled program."""
    runs = sorted(path.parent for path in (folder / RUNS).rglob("run.json"))
    program = [f"{_WHOLE}.program.json", "--weights", f"{_WHOLE}.safetensors"]
    models = [*([str(run.relative_to(folder))] for run in runs), program]
    return [["validate", *words, *_INTERPRETED, "--format", "json"] for words in models]


def simulation(folder: Path) -> list[str]:
    """The arguments that simulate a run with prediction intervals, which its covariance gives."""
    (run,) = (folder / RUNS / _WHOLE).iterdir()
    asked = ("--data-set", "test", "--intervals", "90", "-o", SIMULATED)
    return ["simulate", str(run.relative_to(folder)), *asked, *_INTERPRETED]


def numbers(validated: dict[str, Any]) -> dict[str, Any]:
    """The numbers of what `validate --format json` prints, with what they are measured on."""
    metrics, outputs = validated["metrics"], validated["outputs"]
    return {
        "metrics": [{key: one[key] for key in (*_MEASURE, "metric", "value")} for one in metrics],
        "outputs": [{key: one[key] for key in (*_MEASURE, "metrics")} for one in outputs],
    }


def keep(folder: Path) -> None:
    """Trains, compiles, validates and simulates in the folder."""
    _msnn(folder, "train", f"{_PART}.msnn.yaml", "--out", RUNS)
    shutil.copy(_newest(folder, _PART), folder / f"{_PART}.safetensors")
    _msnn(folder, "train", f"{_WHOLE}.msnn.yaml", "--out", RUNS)
    _msnn(folder, "train", f"{_FOLDS}.msnn.yaml", "--out", RUNS, "--folds")
    _msnn(folder, "compile", f"{_WHOLE}.msnn.yaml", "--out", ".")
    shutil.copy(_newest(folder, _WHOLE), folder / f"{_WHOLE}.safetensors")
    for link in (folder / RUNS).glob("*/latest"):
        link.unlink()
    found = [
        {"arguments": words, "numbers": numbers(json.loads(_msnn(folder, *words)))}
        for words in validations(folder)
    ]
    (folder / EXPECTED).write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    _msnn(folder, *simulation(folder))


def _newest(folder: Path, name: str) -> Path:
    return folder / RUNS / name / "latest" / "weights.safetensors"


def _msnn(folder: Path, *words: str) -> str:
    command = [sys.executable, "-m", "msnn", *words]
    done = subprocess.run(command, cwd=folder, stdout=subprocess.PIPE, text=True, check=True)
    return done.stdout


if __name__ == "__main__":
    keep(Path(sys.argv[1]))

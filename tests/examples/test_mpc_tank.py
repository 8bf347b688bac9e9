"""Tells the tank example: recorded, trained, exported, and its loop closed and written down."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import msnn
from msnn.cli.application import run
from msnn.features.control.run.method import Status
from tests.conditions import require_tool

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "mpc_tank"


def test_steps_of_the_rig_are_small_enough(example: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    plant = example("plant")

    def levels() -> Any:
        rig = plant.Tanks()
        for volts in (8.0, 8.0, 0.5, 5.0) * 10:
            rig.step(volts)
        return rig.levels

    coarse = levels()
    monkeypatch.setattr(plant, "STEPS", 4 * plant.STEPS)
    # a fiftieth of the sensors' noise
    np.testing.assert_allclose(coarse, levels(), atol=1e-3)


def test_a_rig_is_recorded_learned_controlled_and_judged(
    example: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    require_tool("gcc", install="apt-get install gcc")
    record, closed_loop, results = example("record"), example("closed_loop"), example("results")
    monkeypatch.setattr(closed_loop, "SAMPLES", 130)
    monkeypatch.setattr(closed_loop, "LEAK_FROM", 100)
    shutil.copy(EXAMPLE / "tank.msnn.yaml", tmp_path)
    (tmp_path / "README.md").write_text("before\n<!-- figures -->\n<!-- end -->\nafter\n")
    record.record(tmp_path / "data")
    monkeypatch.chdir(tmp_path)
    assert run(["train", "tank.msnn.yaml"]) == 0
    assert run(["validate", "tank.msnn.yaml"]) == 0
    assert run(["export", "tank.msnn.yaml", "--check"]) == 0

    model, trained = msnn.load("tank.msnn.yaml"), tmp_path / "runs" / "tank" / "latest"
    mpc = closed_loop.Mpc(model, trained, rival=True)
    runs = {"mpc": closed_loop.run(mpc, 11)}
    runs["now"] = closed_loop.run(closed_loop.Mpc(model, trained, sees_ahead=False), 11)
    runs["pi"] = closed_loop.run(closed_loop.Pi(1.0, 0.006, 3.0), 11)
    page = results.write(results.Judged(runs, mpc, (1.0, 0.006)), tmp_path)
    assert page in (tmp_path / "README.md").read_text()
    assert (tmp_path / "README.md").read_text().endswith("<!-- end -->\nafter\n")
    assert (tmp_path / "figures" / "levels.svg").stat().st_size < 150_000
    told = json.loads((tmp_path / "results.json").read_text())
    assert told["solves"]["solver"] == "c"
    assert {each.status for each in mpc.found} == {Status.SOLVED}
    # the judge adds up its sums in another order
    assert told["solves"]["worst_residual"] <= 1.1e-6
    # both are within a residual of 1e-6; what remains is the least curvature of a voltage, 0.2 / V²
    assert told["ipopt"]["volts_apart"] < 1e-3
    assert told["ipopt"]["cost_apart"] < 1e-5
    errors = {name: figures["rms"] for name, figures in told["loop"].items()}
    assert errors["mpc"] < 0.6 * min(errors["now"], errors["pi"])


def test_the_page_says_what_the_results_say(example: Any) -> None:
    results = example("results")
    found = json.loads((EXAMPLE / "results.json").read_text(encoding="utf-8"))
    page = (EXAMPLE / "README.md").read_text(encoding="utf-8")
    assert " ".join(results.tables(found).split()) in " ".join(page.split())  # prose is wrapped

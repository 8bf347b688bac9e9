"""What the steering example learns from is not what it is judged on: files, roads and noise."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from msnn.data.reading.load import load_data
from msnn.model.load import load_model

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "vehicle_steering"
SPECS = ("vehicle", "controller", "mlp")
SETS = {"train": "training", "val": "validation", "test": "test"}


@pytest.fixture
def example(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Imports a module of the example, and forgets all of them in the end."""
    monkeypatch.syspath_prepend(str(EXAMPLE))
    yield importlib.import_module
    for name in [path.stem for path in EXAMPLE.glob("*.py")]:
        sys.modules.pop(name, None)


def test_no_road_and_no_noise_is_of_two_sets(example: Any) -> None:
    telemetry, setting = example("telemetry"), example("setting")
    by_set = {name: list[Any]() for name in SETS.values()}
    for drive in telemetry.DRIVES:
        by_set[drive.file.partition("/")[0]].append(drive)
    assert [drive.roads for drive in by_set["training"]] == [*setting.TRAINING]
    assert [drive.roads for drive in by_set["validation"]] == [*setting.VALIDATION]
    assert [drive.roads for drive in by_set["test"]] == [setting.TEST]
    assert len({drive.file for drive in telemetry.DRIVES}) == len(telemetry.DRIVES)
    # a road is drawn from its seed alone: two of one seed have the same bends
    assert len({drive.roads.seed for drive in telemetry.DRIVES}) == len(telemetry.DRIVES)
    seeds = [drive.seed() for drive in telemetry.DRIVES]
    assert len({*seeds, example("judge").SEED}) == len(seeds) + 1


def test_the_roads_on_which_plans_are_chosen_and_judged_are_not_those_of_training(
    example: Any,
) -> None:
    judge, validation, setting = example("judge"), example("validation"), example("setting")
    assert judge.judge.__defaults__[-1] == setting.TEST
    assert validation.drive.__defaults__[-1] == setting.VALIDATION


def test_specs_train_on_training_drives_alone(tmp_path: Path) -> None:
    """Rows tell by their speed which file they are from; the other specs name the same files."""
    for number, folder in enumerate(SETS.values()):
        (tmp_path / "data" / folder).mkdir(parents=True)
        (tmp_path / "data" / folder / "drive.csv").write_text(_drive(10.0 + number))
    spec = tmp_path / "vehicle.msnn.yaml"
    spec.write_bytes((EXAMPLE / spec.name).read_bytes())
    model = load_model(spec)
    assert model.spec.data is not None
    data = load_data(model.program, model.spec.data, tmp_path)
    for number, found in enumerate(SETS):
        assert {*np.unique(data.series["v"][data.in_set(found)])} == {10.0 + number}
    texts = [yaml.safe_load((EXAMPLE / f"{name}.msnn.yaml").read_text()) for name in SPECS]
    assert [text["data"]["source"] for text in texts] == 3 * [texts[0]["data"]["source"]]


def test_what_is_fitted_beside_specs_is_fitted_to_training_drives_alone(
    example: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    judge = example("judge")
    for number, folder in enumerate(SETS.values()):
        (tmp_path / "data" / folder).mkdir(parents=True)
        (tmp_path / "data" / folder / "drive.csv").write_text(_drive(10.0 + number))
    seen: list[float] = []

    def fitted(drives: list[dict[str, np.ndarray]], *_: float) -> int:
        seen.extend(float(drive["v"][0]) for drive in drives)
        return 0

    monkeypatch.setattr(judge, "fit_filters", fitted)
    monkeypatch.setattr(judge, "fit_lead", fitted)
    monkeypatch.setattr(judge, "Kinematic", fitted)
    car = type("Car", (), {"wheelbase": 2.7, "to_front": 1.2})()
    judge.controller(tmp_path, "filters", car)
    assert seen == [10.0]


def _drive(speed: float) -> str:
    return "\n".join(["v,a,rho,delta,angle,rho_true", *[f"{speed}" + 5 * ",0.01"] * 400, ""])

"""What the steering example learns from is not what it is judged on: files, roads and noise."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.interpolate import CubicSpline

from msnn.data.dataset import FloatArray
from msnn.data.reading.load import load_data
from msnn.model.load import load_model

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "vehicle_steering"
SPECS = ("vehicle", "controller", "mlp")
SETS = {"train": "training", "val": "validation", "test": "test"}


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


def test_curvatures_are_compared_at_the_sample_that_they_are_of(
    example: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A car that is told what its curvature will be a sample later predicts it without error."""
    open_loop = example("open_loop")
    true = np.sin(np.arange(200.0) ** 1.5 / 40) / 50
    drive = {"v": np.full(200, 10.0), "a": np.zeros(200), "angle": np.arctan(2.7 * true)}
    drive |= {"rho_true": true, "delta": np.append(true[1:], 0.0)}

    class Told:
        def reset(self, **_: float) -> None: ...

        def step(self, delta: float, **_: float) -> dict[str, float]:
            return {"rho_hat": delta}

    monkeypatch.setattr(open_loop.msnn, "load", lambda *_: None)
    monkeypatch.setattr(open_loop.msnn, "stepper", lambda *_: Told())
    found = open_loop.through_vehicle(EXAMPLE / "vehicle.msnn.yaml", drive, drive["delta"])
    assert found.mse == 0
    # rows that every controller and the filter of 30 samples have
    assert len(found.true) == 199 - 30 - 30
    wheels = open_loop.through_kinematics(drive, 2.7)
    assert wheels.worst < 1e-16
    late = open_loop.through_vehicle(EXAMPLE / "vehicle.msnn.yaml", drive, true)
    rows = slice(30, 169)
    assert late.mse == pytest.approx(np.mean((true[:-1][rows] - true[1:][rows]) ** 2), rel=1e-12)
    assert late.worst == pytest.approx(np.max(np.abs(true[:-1][rows] - true[1:][rows])))


@pytest.mark.parametrize(("offset", "turned"), [(1.8, -0.15), (-2.5, 0.2), (0.0, 0.1)])
def test_the_planned_curvature_is_that_of_the_path_in_the_plane(
    offset: float, turned: float, example: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The path laid beside the road point by point, by a polynomial that a linear system gives."""
    preview, roads, setting = example("preview"), example("roads"), example("setting")
    monkeypatch.setattr(preview, "REAR_SLIP", 0.0)  # what is handed on is the path's own
    # tables so fine that a line between their rows is no kink
    way = np.arange(0.0, 120.0, 0.002)
    heading, speeds = 0.9 * (1 - np.cos(way / 30)), 12 + 2 * np.sin(way / 20)
    road = roads.Road(
        way=way,
        x=_integral(np.cos(heading), way),
        y=_integral(np.sin(heading), way),
        heading=heading,
        curvature=0.03 * np.sin(way / 30),
        speed=speeds,
        time=_integral(1 / speeds, way),
    )
    begin, speed = 35.0, 15.0
    place = preview.Place(begin, offset, turned, float(road.at(begin, road.curvature)))
    found = preview.Planner(road, 0.0).plan(place, {"speed": speed})

    T, s = 3.0, setting.SAMPLE_TIME * np.arange(30)
    at = np.arange(6)
    ends = [np.eye(6)[0], np.eye(6)[1], 2 * np.eye(6)[2]]
    ends += [T**at, at * T ** np.maximum(at - 1, 0), at * (at - 1) * T ** np.maximum(at - 2, 0)]
    known = [offset, speed * np.sin(turned), 0.0, 0.0, 0.0, 0.0]
    polynomial = np.linalg.solve(np.array(ends, float), known)
    n = (s[:, None] ** at) @ polynomial
    along = np.interp(road.at(begin, road.time) + s, road.time, road.way)
    ahead = road.at(along, road.heading)
    x = CubicSpline(s, road.at(along, road.x) - n * np.sin(ahead))
    y = CubicSpline(s, road.at(along, road.y) + n * np.cos(ahead))
    inside = slice(4, -4)  # a spline knows little of second slopes at its ends
    bent = x(s, 1) * y(s, 2) - y(s, 1) * x(s, 2)
    curvature = bent / np.hypot(x(s, 1), y(s, 1)) ** 3
    np.testing.assert_allclose(found.curvature[inside], curvature[inside], rtol=0, atol=2e-5)


def test_a_run_is_reduced_to_its_largest_and_its_mean_squares(example: Any) -> None:
    results, setting = example("results"), example("setting")
    n = 5
    none = dict.fromkeys(("x", "y", "way", "angle", "acceleration", "yaw_rate"), np.zeros(n))
    run = example("closed_loop").Run(
        **none,
        offset=np.array([0.1, -0.4, 0.2, 0.0, 0.1]),
        curvature=np.array([0.01, -0.03, 0.0, 0.02, 0.0]),
        wanted=np.array([0.0, -0.01, 0.0, 0.0, 0.0]),
        asked=np.array([0.0, 0.1, -0.2, -0.2, 0.0]),
        speed=np.array([10.0, 20.0, 10.0, 10.0, 10.0]),
        arrived=True,
    )
    runs = {(c, v.name): run for c in results.CONTROLLERS for v in setting.VARIATIONS}
    solve = example("predictive").Solve
    ways = [solve(status="SOLVED", iterations=i, taken=1e-3 * i) for i in (2, 3, 10)]
    judged = example("judge").Judged(
        runs=runs, by={}, solves=ways, traces={}, lead=0, finer_steps=0.0, translated=0.0
    )
    found = results.numbers(judged, {})
    assert found["closed_loop"]["nominal"]["controller"] == {
        "arrived": True,
        "max": 0.4,
        "rms": pytest.approx(np.sqrt(0.22 / 5)),
        "rate_max": pytest.approx(6.0),  # 0.3 rad in 50 ms
        "rate_rms": pytest.approx(np.sqrt((4 + 36 + 0 + 16) / 4)),
        "curvature_mse": pytest.approx((1e-4 + 4e-4 + 4e-4) / 5),
        "sideways": pytest.approx(12.0),
    }
    assert found["solves"]["ms"][0] == pytest.approx(3.0)
    assert found["solves"]["iterations"] == 5.0
    assert found["solves"]["most_iterations"] == 10


def _integral(slope: FloatArray, over: FloatArray) -> FloatArray:
    return np.append(0.0, np.cumsum(np.diff(over) * (slope[1:] + slope[:-1]) / 2))


def _drive(speed: float) -> str:
    return "\n".join(["v,a,rho,delta,angle,rho_true", *[f"{speed}" + 5 * ",0.01"] * 400, ""])

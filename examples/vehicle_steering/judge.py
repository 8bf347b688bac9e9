"""Drives every controller on the test road in every variation of the car, and takes the figures."""

import os
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from closed_loop import Controller, Run, run
from drivers import Kinematic, Stanley
from learned import Exported, fit_filters, fit_lead
from multi_body import Car, MultiBody
from open_loop import Drive, Trace, read, steered, through_kinematics, through_vehicle
from predictive import Predictive, Solve
from roads import draw
from setting import REAR_SLIP, SUBSTEPS, TEST, VARIATIONS, Roads, Variation

CONTROLLERS = ("controller", "mlp", "mpc", "filters", "kinematic", "stanley")
PREVIEWING = CONTROLLERS[:5]
VEHICLE = "vehicle.msnn.yaml"
SEED = 7  # of the sensors' noise in the tests, the same for all


@dataclass(frozen=True)
class Judged:
    """What was measured."""

    runs: dict[tuple[str, str], Run]
    """By controller and variation."""
    by: dict[str, str]
    """What computed the angles of each controller: its exported C, or Python."""
    solves: list[Solve]
    """Of the predictive controller, in all variations."""
    traces: dict[str, Trace]
    """Curvatures on the recorded test drive, of both vehicles and of controllers."""
    lead: int
    """Samples that the kinematic controller looks ahead."""
    finer_steps: float
    """How far offsets move with a quarter of the car's integration step [m]."""
    translated: float
    """How far the translated car is from the package's Python, over the size of each slope."""


def judge(folder: Path, car_of: Callable[..., Car] = MultiBody, roads: Roads = TEST) -> Judged:
    """Everything, in a folder that has the specs, the data and the trained models."""
    nominal = VARIATIONS[0]
    cases = [(name, variation, SUBSTEPS) for variation in VARIATIONS for name in CONTROLLERS]
    cases.append(("controller", nominal, 4 * SUBSTEPS))
    with ProcessPoolExecutor(min(os.cpu_count() or 1, 4), get_context("spawn")) as pool:
        planned = {name: pool.submit(_planned, folder, car_of, name) for name in PREVIEWING}
        driven = [pool.submit(_driven, folder, car_of, roads, *case) for case in cases]
        traces = {name: trace.result() for name, trace in planned.items()}
        done = [case.result() for case in driven]
    *runs, finer = [each.run for each in done]
    by_case = {(name, v.name): r for (name, v, _), r in zip(cases[:-1], runs, strict=True)}
    coarse = by_case["controller", nominal.name]
    rows = min(len(coarse.offset), len(finer.offset))
    drive, car = _test_drive(folder), car_of(nominal)
    recorded = {
        "vehicle": through_vehicle(folder / VEHICLE, drive, drive["delta"]),
        "wheels": through_kinematics(drive, car.wheelbase),
    }
    return Judged(
        runs=by_case,
        by={name: each.by for (name, _, _), each in zip(cases, done, strict=True)},
        solves=[solve for each in done for solve in each.solves],
        traces={**recorded, **traces},
        lead=fit_lead(_training(folder), car.wheelbase),
        finer_steps=float(np.max(np.abs(coarse.offset[:rows] - finer.offset[:rows]))),
        translated=_translated(car),
    )


def controller(folder: Path, name: str, car: Car) -> Controller:
    """A controller by its name, ready to drive."""
    match name:
        case "kinematic":
            return Kinematic(car.wheelbase, fit_lead(_training(folder), car.wheelbase))
        case "filters":
            return fit_filters(_training(folder))
        case "stanley":
            return Stanley(car.wheelbase, car.to_front, REAR_SLIP)
        case "mpc":
            return Predictive(folder / VEHICLE)
        case _:
            spec = folder / f"{name}.msnn.yaml"
            return Exported(spec, planned_speeds=name == "controller")


@dataclass(frozen=True)
class _Driven:
    """A run on the road, what computed its angles, and what was solved for them."""

    run: Run
    by: str
    solves: list[Solve]


def _driven(
    folder: Path,
    car_of: Callable[..., Car],
    roads: Roads,
    name: str,
    variation: Variation,
    substeps: int,
) -> _Driven:
    car = car_of(variation, substeps)
    steering = controller(folder, name, car)
    found = run(car, steering, draw(roads), SEED)
    return _Driven(
        run=found,
        by=steering.by if isinstance(steering, Exported | Predictive) else "python",
        solves=steering.solves if isinstance(steering, Predictive) else [],
    )


def _planned(folder: Path, car_of: Callable[..., Car], name: str) -> Trace:
    """The learned vehicle, steered by a controller for which the test drive is the planned path."""
    drive = _test_drive(folder)
    asked = steered(controller(folder, name, car_of(VARIATIONS[0])), drive)
    whole = np.append(asked, drive["delta"][len(asked) :])
    return through_vehicle(folder / VEHICLE, drive, whole)


def _test_drive(folder: Path) -> Drive:
    return read(folder / "data" / "test" / "drive.csv")


def _training(folder: Path) -> list[Drive]:
    return [read(path) for path in sorted((folder / "data" / "training").glob("*.csv"))]


def _translated(car: Car) -> float:
    """The largest difference over a bend that the car drives by itself."""
    if not isinstance(car, MultiBody):
        return 0.0
    car.start(0.0, 0.0, 0.0, 15.0)
    worst = 0.0
    for step in range(100):
        car.step(0.05 * np.sin(0.1 * step), 1.0 - 0.03 * step)
        worst = max(worst, car.difference(0.1 * np.cos(step), 1.0 - 0.03 * step))
    return worst

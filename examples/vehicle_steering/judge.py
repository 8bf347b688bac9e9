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
from roads import draw
from setting import REAR_SLIP, SUBSTEPS, TEST, VARIATIONS, Roads, Variation

CONTROLLERS = ("controller", "mlp", "filters", "kinematic", "stanley")
PREVIEWING = CONTROLLERS[:4]
SEED = 7  # of the sensors' noise in the tests, the same for all


@dataclass(frozen=True)
class Judged:
    """What was measured."""

    runs: dict[tuple[str, str], Run]
    """By controller and variation."""
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
        done = [pool.submit(_driven, folder, car_of, roads, *case) for case in cases]
        runs = [case.result() for case in done]
    by_case = {(name, v.name): r for (name, v, _), r in zip(cases[:-1], runs[:-1], strict=True)}
    coarse, fine = by_case["controller", nominal.name].offset, runs[-1].offset
    rows = min(len(coarse), len(fine))
    drive = read(folder / "data" / "test" / "drive.csv")
    car, vehicle = car_of(nominal), folder / "vehicle.msnn.yaml"
    traces = {
        "vehicle": through_vehicle(vehicle, drive, drive["delta"]),
        "wheels": through_kinematics(drive, car.wheelbase),
    }
    for name in PREVIEWING:
        asked = steered(controller(folder, name, car), drive)
        traces[name] = through_vehicle(
            vehicle, drive, np.append(asked, drive["delta"][len(asked) :])
        )
    return Judged(
        runs=by_case,
        traces=traces,
        lead=fit_lead(_training(folder), car.wheelbase),
        finer_steps=float(np.max(np.abs(coarse[:rows] - fine[:rows]))),
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
        case _:
            spec = folder / f"{name}.msnn.yaml"
            return Exported(spec, planned_speeds=name == "controller")


def _driven(
    folder: Path,
    car_of: Callable[..., Car],
    roads: Roads,
    name: str,
    variation: Variation,
    substeps: int,
) -> Run:
    car = car_of(variation, substeps)
    return run(car, controller(folder, name, car), draw(roads), SEED)


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

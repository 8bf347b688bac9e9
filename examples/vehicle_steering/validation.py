"""Drives the nominal car on the validation roads, by which the beginning of plans was chosen.

It takes the trained controller; `validation.json` and README get what other plans give.
"""

import json
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from closed_loop import Run, run
from judge import SEED, controller
from multi_body import Car, MultiBody
from preview import Place, Planner
from results import show
from roads import draw
from setting import VALIDATION, VARIATIONS, Roads

HERE = Path(__file__).resolve().parent
BEGIN = "<!-- validation -->"
Figures = Mapping[str, Mapping[str, float]]


class Straight(Planner):
    """Begins each plan without a second slope."""

    def second_slope(self, place: Place, sensors: Mapping[str, float]) -> float:
        return 0.0


class Measured(Planner):
    """Begins each plan with the second slope that speed and yaw rate say the car has now."""

    def second_slope(self, place: Place, sensors: Mapping[str, float]) -> float:
        v = sensors["speed"]
        return v * (sensors["yaw_rate"] - v * place.curvature)


PLANNERS: dict[str, type[Planner]] = {
    "as the last one bends": Planner,
    "straight": Straight,
    "as the car was measured to turn": Measured,
}


def main() -> int:
    """Everything, with the controller that the demo has trained."""
    found = drive(HERE)
    write(found, HERE)
    print(table(found))
    return 0


def drive(
    folder: Path, car_of: Callable[..., Car] = MultiBody, roads: Sequence[Roads] = VALIDATION
) -> Figures:
    """The means over the roads, by how plans begin."""
    with ProcessPoolExecutor(min(os.cpu_count() or 1, 4), get_context("spawn")) as pool:
        runs = {
            name: [pool.submit(_driven, folder, car_of, road, name) for road in roads]
            for name in PLANNERS
        }
        return {name: _means([each.result() for each in found]) for name, found in runs.items()}


def write(found: Figures, folder: Path) -> None:
    """`validation.json`, and the table of it in README."""
    text = json.dumps(found, indent=1) + "\n"
    (folder / "validation.json").write_text(text, encoding="utf-8")
    show(table(found), folder / "README.md", BEGIN)


def table(found: Figures) -> str:
    """The table of README."""
    lines = ["| a plan begins | largest offset, m | steering rate, rms, rad/s |", "|---|---|---|"]
    for name, row in found.items():
        lines.append(f"| {name} | {row['max']:.2f} | {row['rate_rms']:.3f} |")
    return "\n".join(lines)


def _driven(folder: Path, car_of: Callable[..., Car], roads: Roads, name: str) -> Run:
    car = car_of(VARIATIONS[0])
    return run(car, controller(folder, "controller", car), draw(roads), SEED, PLANNERS[name])


def _means(runs: Sequence[Run]) -> dict[str, float]:
    if not all(each.arrived for each in runs):
        raise SystemExit("a car was lost")
    figures = {
        "max": [np.max(np.abs(each.offset)) for each in runs],
        "rate_rms": [np.sqrt(np.mean(each.steering_rate**2)) for each in runs],
    }
    return {name: float(f"{np.mean(values):.4g}") for name, values in figures.items()}


if __name__ == "__main__":
    raise SystemExit(main())

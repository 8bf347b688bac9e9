"""Records drives of the multi-body car: training and validation with waves, the test without."""

import os
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from closed_loop import Controller, Run, run
from drivers import Exploring, Stanley
from multi_body import Car, MultiBody
from roads import draw
from setting import REAR_SLIP, TEST, TRAINING, VALIDATION, VARIATIONS, WAVES, Roads

COLUMNS = "v,a,rho,delta,angle,rho_true"


@dataclass(frozen=True)
class Drive:
    """One drive that is to be recorded."""

    file: str
    roads: Roads
    waves: float  # rad

    def seed(self) -> int:
        """Of the sensors' noise and of the waves."""
        return self.roads.seed + 1000


DRIVES = (
    *(Drive(f"training/drive_{i + 1:02d}.csv", r, WAVES) for i, r in enumerate(TRAINING)),
    *(Drive(f"validation/drive_{i + 1:02d}.csv", r, WAVES) for i, r in enumerate(VALIDATION)),
    Drive("test/drive.csv", TEST, 0.0),
)


def record(folder: Path) -> None:
    """Writes all drives to CSV files, as many at a time as there are processors."""
    with ProcessPoolExecutor(min(os.cpu_count() or 1, 4), get_context("spawn")) as pool:
        done = [pool.submit(record_one, drive, folder) for drive in DRIVES]
        for drive, rows in zip(DRIVES, done, strict=True):
            print(f"{drive.file}: {rows.result()} samples")


def record_one(drive: Drive, folder: Path, car_of: Callable[..., Car] = MultiBody) -> int:
    """Writes one drive; the number of its samples."""
    car = car_of(VARIATIONS[0])
    driver: Controller = Stanley(car.wheelbase, car.to_front, REAR_SLIP)
    if drive.waves:
        driver = Exploring(driver, drive.seed(), drive.waves)
    return write(run(car, driver, draw(drive.roads), drive.seed()), folder / drive.file)


def write(found: Run, path: Path) -> int:
    """Writes a run under a temporary name, then renames it: no file is ever half written."""
    path.parent.mkdir(parents=True, exist_ok=True)
    curvature = found.yaw_rate / found.speed  # of noisy sensors
    columns = (found.speed, found.acceleration, curvature, found.asked, found.angle)
    rows = np.column_stack((*columns, found.curvature))
    unfinished = path.with_suffix(".unfinished")
    np.savetxt(unfinished, rows, fmt="%.7g", delimiter=",", header=COLUMNS, comments="")
    unfinished.replace(path)
    return len(rows)


if __name__ == "__main__":
    record(Path(__file__).parent / "data")

"""Simulate a car that understeers, and write drives on winding roads as CSV files.

A linear single-track model with side slip and yaw rate, tyres that are softer in front (Rajamani,
Vehicle Dynamics and Control, 2012, chapter 2), and a steering gear. Only the curvature is noisy.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Car:
    """Mass [kg], yaw inertia [kg m²], axles from the centre [m], tyres [N/rad], steering gear."""

    mass: float = 1500.0
    inertia: float = 2500.0
    front: float = 1.2
    rear: float = 1.5
    front_stiffness: float = 90e3
    rear_stiffness: float = 110e3
    gear: float = 15.0


SAMPLE_TIME = 0.05  # s
SAMPLES = 1200  # a drive of one minute
FINER = 10  # steps of the simulation in a sample
DRIVES = {"training": 10, "validation": 3, "test": 3}
CURVATURE_NOISE = 1e-4  # 1/m, standard deviation
SEED = 20250301


def main() -> None:
    """Write `training/*.csv`, `validation/*.csv` and `test/*.csv`, by default under `data`."""
    parser = argparse.ArgumentParser(description="Simulate the drives of the example.")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "data")
    parser.add_argument("--seed", type=int, default=SEED)
    arguments = parser.parse_args()
    random = np.random.default_rng(arguments.seed)
    for part, count in DRIVES.items():
        for number in range(1, count + 1):
            speed, acceleration = speeds(random)
            steering = steered(Car(), speed, random)
            curvature = simulate(Car(), speed, steering)
            measured = curvature + CURVATURE_NOISE * random.standard_normal(SAMPLES)
            path = arguments.out / part / f"drive_{number:02d}.csv"
            write_drive(path, np.column_stack((speed, acceleration, measured, steering)))
        print(f"wrote {count} drives of {SAMPLES} samples to {arguments.out / part}")


def speeds(random: np.random.Generator) -> tuple[Array, Array]:
    """A speed [m/s] between 9 and 22 that swings slowly, and its slope [m/s²]."""
    time = SAMPLE_TIME * np.arange(SAMPLES)
    periods = random.uniform(25.0, 60.0, size=2)
    phases = random.uniform(0.0, 2 * np.pi, size=2)
    angles = 2 * np.pi * time / periods[:, None] + phases[:, None]
    speed = 15.5 + 3.25 * np.sin(angles).sum(axis=0)
    slope = (3.25 * np.cos(angles) * (2 * np.pi / periods)[:, None]).sum(axis=0)
    return speed, slope


def steered(car: Car, speed: Array, random: np.random.Generator) -> Array:
    """Angles of the steering wheel [rad] for bends that keep the lateral acceleration at 3 m/s²."""
    time = SAMPLE_TIME * np.arange(SAMPLES)
    frequencies = np.array([0.03, 0.07, 0.13, 0.22, 0.4])
    phases = random.uniform(0.0, 2 * np.pi, size=frequencies.size)
    sizes = random.uniform(0.5, 1.0, size=frequencies.size)
    waves = sizes[:, None] * np.sin(2 * np.pi * frequencies[:, None] * time + phases[:, None])
    curvature = waves.sum(axis=0) * 3.0 / sizes.sum() / speed**2
    return car.gear * curvature * (car.front + car.rear + understeer(car) * speed**2)


def understeer(car: Car) -> float:
    """Steering that a lateral acceleration needs besides that of the bend [rad s²/m]."""
    base = car.front + car.rear
    front, rear = car.rear / car.front_stiffness, car.front / car.rear_stiffness
    return car.mass / base * (front - rear)


def simulate(car: Car, speed: Array, steering: Array) -> Array:
    """The curvature [1/m] of the path, yaw rate over speed, with the steering held in a sample."""
    slip, yaw_rate = 0.0, 0.0
    curvature = np.empty(speed.size)
    for index, (v, angle) in enumerate(zip(speed, steering / car.gear, strict=True)):
        curvature[index] = yaw_rate / v
        for _ in range(FINER):
            front = car.front_stiffness * (angle - slip - car.front * yaw_rate / v)
            rear = car.rear_stiffness * (-slip + car.rear * yaw_rate / v)
            slip += SAMPLE_TIME / FINER * ((front + rear) / (car.mass * v) - yaw_rate)
            moment = car.front * front - car.rear * rear
            yaw_rate += SAMPLE_TIME / FINER * moment / car.inertia
    return curvature


def write_drive(path: Path, rows: Array) -> None:
    """Write one drive under a temporary name, then rename it: no file is ever half written."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = ["vx,ax,curv,steer", *(f"{v:.5f},{a:.5f},{c:.7f},{s:.6f}" for v, a, c, s in rows)]
    unfinished = path.with_suffix(".unfinished")
    unfinished.write_text("\n".join(lines) + "\n", encoding="utf-8")
    unfinished.replace(path)


if __name__ == "__main__":
    main()

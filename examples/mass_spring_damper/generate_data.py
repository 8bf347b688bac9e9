"""Simulate a mass on a spring and damper, and write 40 noisy episodes as CSV files.

The motion is exact: the force is held between samples, so that one step of the sampled system is
the matrix exponential of the continuous one. Only the measured position is noisy.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Plant:
    """mass · d²x/dt² + damping · dx/dt + stiffness · x = F, in kg, N s/m and N/m."""

    mass: float = 2.0
    damping: float = 1.5
    stiffness: float = 12.0


SAMPLE_TIME = 0.2  # s
SAMPLES = 151  # an episode of 30 s
TRAIN_EPISODES = 32
TEST_EPISODES = 8
POSITION_NOISE = 5e-4  # m, standard deviation
SEED = 20240229


def main() -> None:
    """Write `train/*.csv` and `test/*.csv` under a folder, by default `data` beside this file."""
    parser = argparse.ArgumentParser(description="Simulate the episodes of the example.")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "data")
    parser.add_argument("--seed", type=int, default=SEED)
    arguments = parser.parse_args()
    random = np.random.default_rng(arguments.seed)
    for part, count in (("train", TRAIN_EPISODES), ("test", TEST_EPISODES)):
        for number in range(1, count + 1):
            force = excitation(random)
            position = simulate(Plant(), force, random)
            measured = position + POSITION_NOISE * random.standard_normal(SAMPLES)
            write_episode(arguments.out / part / f"episode_{number:02d}.csv", measured, force)
        print(f"wrote {count} episodes of {SAMPLES} samples to {arguments.out / part}")


def excitation(random: np.random.Generator) -> Array:
    """A force [N] of random steps, 1 to 4 s long, and six sines of 0.05 to 0.55 Hz."""
    time = SAMPLE_TIME * np.arange(SAMPLES)
    lengths = random.integers(5, 21, size=SAMPLES // 5 + 1)
    levels = random.uniform(-3.0, 3.0, size=lengths.size)
    steps = np.repeat(levels, lengths)[:SAMPLES]
    frequencies = np.linspace(0.05, 0.55, 6)
    phases = random.uniform(0.0, 2 * np.pi, size=6)
    sines = 0.3 * np.sin(2 * np.pi * np.outer(time, frequencies) + phases)
    return steps + sines.sum(axis=1)


def simulate(plant: Plant, force: Array, random: np.random.Generator) -> Array:
    """The true position [m] at the samples, from a random position and speed."""
    transition, effect = sampled(plant)
    state = random.uniform([-0.2, -0.4], [0.2, 0.4])
    position = np.empty(force.size)
    for index, value in enumerate(force):
        position[index] = state[0]
        state = transition @ state + effect * value
    return position


def sampled(plant: Plant) -> tuple[Array, Array]:
    """The transition matrix over one sample, and the effect of 1 N held meanwhile.

    Both are blocks of exp(M·T) with M = [[A, b], [0, 0]] (Van Loan, 1978).
    """
    generator = np.zeros((3, 3))
    generator[0, 1] = 1.0
    generator[1] = np.array([-plant.stiffness, -plant.damping, 1.0]) / plant.mass
    block = exponential(SAMPLE_TIME * generator)
    return block[:2, :2], block[:2, 2]


def exponential(matrix: Array) -> Array:
    """exp(matrix) by its power series; 30 terms reach rounding for the small norms used here."""
    total = np.eye(matrix.shape[0])
    term = total
    for order in range(1, 30):
        term = term @ matrix / order
        total = total + term
    return total


def write_episode(path: Path, position: Array, force: Array) -> None:
    """Write one episode under a temporary name, then rename it: no file is ever half written."""
    path.parent.mkdir(parents=True, exist_ok=True)
    time = SAMPLE_TIME * np.arange(SAMPLES)
    rows = np.column_stack((time, position, force))
    lines = ["time;x;F", *(f"{row[0]:.1f};{row[1]:.6f};{row[2]:.6f}" for row in rows)]
    unfinished = path.with_suffix(".unfinished")
    unfinished.write_text("\n".join(lines) + "\n", encoding="utf-8")
    unfinished.replace(path)


if __name__ == "__main__":
    main()

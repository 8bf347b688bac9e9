"""Measures what holding a sampled force costs: learned physics of a Bouc-Wen oscillator.

    python benchmarks/identification/between_samples.py [--rate 1500] [--write]

The equations and their values are those of the hysteretic benchmark (Noël, Schoukens: Hysteretic
benchmark with a dynamic nonlinearity, 2016) under a random-phase multisine of 5 … 150 Hz: a force
that is known at every time. They are integrated with 16 steps a sample, and what a logger would see
of force and travel is every 16th row, the travel of training with noise of 40 dB. One spec is
trained on it from the same guesses, with the force held and with the line from sample to sample.
`--write` puts the tables of 750 and 1500 samples a second into between_samples.md.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from msnn.api import measurements, trainings
from msnn.data.dataset import FloatArray
from msnn.model.load import load_model
from msnn.tables import table_text

HERE = Path(__file__).resolve().parent
Array = NDArray[np.float64]

SECONDS, FINE = 4096 / 750, 16
"""Length of a record, one period of the force; steps of the simulation a sample."""
MASS = 2.0
TRUE = {
    "damping": 10.0,
    "stiffness": 5e4,
    "hysteresis": 5e4,
    "dissipation": 1e3 * 0.8,
    "hardening": 1e3 * -1.1,
}
SEEDS = (1, 2, 3)


def multisine(random: np.random.Generator) -> Callable[[float], float]:
    """A force as a function of time: 50 N rms, all frequencies of the recording between 5 and 150
    Hz.
    """
    lines = np.arange(1, 150 * SECONDS) / SECONDS
    lines = 2 * np.pi * lines[lines >= 5]
    phases = random.uniform(0, 2 * np.pi, len(lines))
    size = 50.0 * np.sqrt(2 / len(lines))
    return lambda t: float(size * np.sum(np.cos(lines * t + phases)))


def slope(x: Array, force: float) -> Array:
    """The derivatives y', v' and z' by the published equations, with ν = 1."""
    y, v, z = x
    given = TRUE["stiffness"] * y + TRUE["damping"] * v + z
    lost = TRUE["dissipation"] * abs(v) * z + TRUE["hardening"] * v * abs(z)
    return np.array([v, (force - given) / MASS, TRUE["hysteresis"] * v - lost])


def record(random: np.random.Generator, rate: float) -> tuple[Array, Array]:
    """The force and the displacement at every sample, from rest."""
    force = multisine(random)
    h = 1 / rate / FINE
    x = np.zeros(3)
    rows = np.empty((round(SECONDS * rate), 2))
    for step in range(len(rows) * FINE):
        now, middle, then = (force((step + part) * h) for part in (0.0, 0.5, 1.0))
        if step % FINE == 0:
            rows[step // FINE] = now, x[0]
        k1 = slope(x, now)
        k2 = slope(x + h / 2 * k1, middle)
        k3 = slope(x + h / 2 * k2, middle)
        k4 = slope(x + h * k3, then)
        x = x + h / 6 * (k1 + 2 * (k2 + k3) + k4)
    return rows[:, 0], rows[:, 1]


def write_records(folder: Path, rate: float, seed: int) -> None:
    """Writes a noisy recording for training, and one without noise for validation."""
    random = np.random.Generator(np.random.Philox(seed))
    for name, noise in (("train", 0.01), ("test", 0.0)):
        force, travel = record(random, rate)
        travel = travel + noise * float(np.std(travel)) * random.normal(size=len(travel))
        table = np.column_stack([force, travel])
        header = "force,travel"
        np.savetxt(folder / f"{name}.csv", table, "%.9e", ",", header=header, comments="")


def trained(folder: Path, rate: float, between: str) -> tuple[dict[str, FloatArray], float]:
    """The learned parameters, and the rms error of the displacement over the test recording."""
    settings = [f"inputs.force.between={between}", f"sample_time={rate:g} Hz"]
    model = load_model(HERE / "bouc_wen.msnn.yaml", settings)
    result = trainings.train(model, data_root=folder, runs=None)
    report = measurements.validate(model, result.weights, data_root=folder)
    return dict(result.weights), float(report.rows[0].value)


def measured(rate: float) -> str:
    """A table of the results with `hold` and with `linear`, over several draws of force and
    noise.
    """
    rows: list[tuple[str, ...]] = [("true", *(f"{value:.5g}" for value in TRUE.values()), "")]
    for between in ("hold", "linear"):
        for seed in SEEDS:
            with tempfile.TemporaryDirectory() as folder:
                write_records(Path(folder), rate, seed)
                weights, rms = trained(Path(folder), rate, between)
            values = (f"{float(weights[name]):.5g}" for name in TRUE)
            rows.append((f"{between}, seed {seed}", *values, f"{1e6 * rms:.3g}"))
            print(rows[-1], file=sys.stderr, flush=True)
    header = ("between", *TRUE, "test rms (µm)")
    return table_text(header, rows, numbers=[*range(1, len(header))])


if __name__ == "__main__":
    title, _, about = (__doc__ or "").partition("\n")
    parser = argparse.ArgumentParser(description=title)
    parser.add_argument("--rate", type=float, help="samples a second; 750 and then 1500")
    parser.add_argument("--write", action="store_true", help="put the tables into the page")
    chosen = parser.parse_args()
    tables = {rate: measured(rate) for rate in ([chosen.rate] if chosen.rate else [750, 1500])}
    fence = "```"
    parts = [
        f"{rate:g} samples a second:\n\n{fence}\n{one}\n{fence}" for rate, one in tables.items()
    ]
    text = "\n\n".join(parts)
    print(text)
    if chosen.write:
        about = about.strip().partition("\n\n")[2].partition("`--write`")[0]
        page = f"# A held force and a line between its samples\n\n{about.strip()}\n\n{text}\n"
        (HERE / "between_samples.md").write_text(page, encoding="utf-8")

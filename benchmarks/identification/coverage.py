"""Measures whether standard errors and prediction intervals are as wide as they say.

    python benchmarks/identification/coverage.py [--repetitions 200] [--write]

An oscillator, Duffing's and that of Bouc and Wen are simulated with known values, by the classical
Runge-Kutta method with 16 steps a sample and the force between samples as the model has it. Each
repetition has a force of its own (a random-phase multisine), noise of its own on the travel, 1 % of
the rms of all records, and a second record to measure on. Parameters are learned from the same
wrong guesses by levenberg_marquardt over the whole record; "started" is the oscillator in rollouts
of 50 rows, 15 of which decide where each starts. Right is: the true value lies within two standard
errors of the learned one in 95.4 % of the repetitions, give or take 1.5 % by chance over 200; a
share p of new values lies in the interval of p; the spread of what is learned is its
standard error. `--write` puts the table into coverage.md.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from msnn.api import measurements, trainings
from msnn.model.load import load_model
from msnn.tables import table_text
from msnn.validation.statistics.coverage import LEVELS

HERE = Path(__file__).resolve().parent
Array = NDArray[np.float64]
Slope = Callable[[Array, Array], Array]

FINE, NOISE = 16, 0.01
"""Steps of the simulation a sample; noise as a part of the rms of all travels."""
MASS = 2.0


@dataclass(frozen=True)
class System:
    """A system with known parameter values, and the spec that estimates them."""

    spec: str
    settings: tuple[str, ...]
    rate: float
    band: tuple[float, float]
    """Of the force, in Hz."""
    force: float
    """Its rms."""
    rows: int
    held: bool
    true: Mapping[str, float]
    states: int
    slope: Slope


def _oscillator(x: Array, force: Array) -> Array:
    y, v = x
    return np.stack([v, (force - 200.0 * y - 3.0 * v) / MASS])


def _duffing(x: Array, force: Array) -> Array:
    y, v = x
    return np.stack([v, (force - 200.0 * y - 1000.0 * y**3 - 3.0 * v) / MASS])


def _bouc_wen(x: Array, force: Array) -> Array:
    y, v, z = x
    lost = 800.0 * np.abs(v) * z - 1100.0 * v * np.abs(z)
    return np.stack([v, (force - 5e4 * y - 10.0 * v - z) / MASS, 5e4 * v - lost])


SYSTEMS = {
    "oscillator": System(
        spec="oscillator.msnn.yaml",
        settings=(),
        rate=50.0,
        band=(0.05, 5.0),
        force=30.0,
        rows=1000,
        held=True,
        true={"damping": 3.0, "stiffness": 200.0},
        states=2,
        slope=_oscillator,
    ),
    "started": System(
        spec="oscillator.msnn.yaml",
        settings=(
            "states.x.init={fit: {over: 15}}",
            "states.v.init={fit: {over: 15}}",
            "train.0.rollout={horizon: 50, stride: 50}",
            "train.0.epochs=20",
        ),
        rate=50.0,
        band=(0.05, 5.0),
        force=30.0,
        rows=1000,
        held=True,
        true={"damping": 3.0, "stiffness": 200.0},
        states=2,
        slope=_oscillator,
    ),
    "duffing": System(
        spec="duffing.msnn.yaml",
        settings=(),
        rate=50.0,
        band=(0.05, 5.0),
        force=30.0,
        rows=1000,
        held=False,
        true={"damping": 3.0, "stiffness": 200.0, "hardening": 1000.0},
        states=2,
        slope=_duffing,
    ),
    "bouc_wen": System(
        spec="bouc_wen.msnn.yaml",
        settings=("inputs.force.between=linear", "integrator={rk4: {substeps: 4}}"),
        rate=750.0,
        band=(5.0, 150.0),
        force=50.0,
        rows=2048,
        held=False,
        true={
            "damping": 10.0,
            "stiffness": 5e4,
            "hysteresis": 5e4,
            "dissipation": 800.0,
            "hardening": -1100.0,
        },
        states=3,
        slope=_bouc_wen,
    ),
}


def forces(system: System, count: int, random: np.random.Generator) -> Array:
    """Random multisine forces with all frequencies inside the band, (rows, count)."""
    lines = np.fft.rfftfreq(system.rows, 1 / system.rate)
    inside = (lines >= system.band[0]) & (lines <= system.band[1])
    phases = random.uniform(0, 2 * np.pi, (len(lines), count))
    found = np.fft.irfft(inside[:, None] * np.exp(1j * phases), system.rows, axis=0)
    return system.force * found / np.sqrt(np.mean(found**2, axis=0))


def travels(system: System, force: Array) -> Array:
    """The displacement at every sample from rest, for all forces together: (rows, count)."""
    h = 1 / system.rate / FINE
    x = np.zeros((system.states, force.shape[1]))
    found = np.empty_like(force)
    for row in range(len(force)):
        found[row] = x[0]
        now = force[row]
        then = now if system.held else force[min(row + 1, len(force) - 1)]
        for part in range(FINE):
            begin, middle, end = (
                now + (then - now) * (part + each) / FINE for each in (0.0, 0.5, 1.0)
            )
            k1 = system.slope(x, begin)
            k2 = system.slope(x + h / 2 * k1, middle)
            k3 = system.slope(x + h / 2 * k2, middle)
            k4 = system.slope(x + h * k3, end)
            x = x + h / 6 * (k1 + 2 * (k2 + k3) + k4)
    return found


@dataclass(frozen=True)
class Repetition:
    """The parameters that one training estimated, and the coverage of its intervals."""

    learned: Array
    errors: Array
    inside: Array


def repetitions(name: str, count: int) -> list[Repetition]:
    """Trains `count` times, each on its own noisy recording."""
    system = SYSTEMS[name]
    random = np.random.Generator(np.random.Philox(1))
    force = forces(system, 2 * count, random)
    exact = travels(system, force)
    noise = NOISE * np.std(exact) * random.normal(size=exact.shape)
    travel = exact + noise
    model = load_model(HERE / system.spec, list(system.settings))
    found: list[Repetition] = []
    with tempfile.TemporaryDirectory() as folder:
        for number in range(count):
            data = {
                part: {"force": force[:, place], "travel": travel[:, place]}
                for part, place in (("train", number), ("test", count + number))
            }
            result = trainings.train(model, data, runs=folder)
            report = measurements.validate(model, result, data, engine="native", intervals=True)
            coverage, errors = report.measurements[0].coverage, result.standard_errors
            assert coverage is not None
            assert errors is not None
            found.append(
                Repetition(
                    np.array([float(result.weights[each]) for each in system.true]),
                    np.array([float(errors.errors[each]) for each in system.true]),
                    np.array(coverage.observed),
                )
            )
    return found


def tables(count: int, systems: Sequence[str]) -> str:
    """Tables of how often true values are in their confidence intervals, and new values in
    prediction intervals.
    """
    of_parameters: list[tuple[str, ...]] = []
    of_intervals: list[tuple[str, ...]] = []
    for name in systems:
        system = SYSTEMS[name]
        found = repetitions(name, count)
        learned, errors = (
            np.stack([getattr(each, key) for each in found]) for key in ("learned", "errors")
        )
        true = np.array(list(system.true.values()))
        within = np.mean(np.abs(learned - true) <= 2 * errors, axis=0)
        for place, parameter in enumerate(system.true):
            values = (
                true[place],
                learned[:, place].mean(),
                learned[:, place].std(ddof=1),
                errors[:, place].mean(),
            )
            shown = (f"{value:.5g}" for value in values)
            of_parameters.append((name, parameter, *shown, f"{within[place]:.1%}"))
        inside = np.stack([each.inside for each in found])
        kept = float(np.mean((inside[:, -1] >= 0.9) & (inside[:, -1] <= 0.98)))
        shares = (f"{share:.1%}" for share in inside.mean(axis=0))
        ends = (f"{end:.1%}" for end in (inside[:, -1].min(), inside[:, -1].max()))
        of_intervals.append((name, *shares, *ends, f"{kept:.1%}"))
        print(of_parameters[-1], of_intervals[-1], file=sys.stderr, flush=True)
    header = ("system", "parameter", "true", "mean", "spread", "std. error", "within 2")
    levels = (f"in {level:.0%}" for level in LEVELS)
    second = ("system", *levels, "least 95%", "most 95%", "90 … 98%")
    return "\n\n".join(
        (
            table_text(header, of_parameters, numbers=range(2, 7)),
            table_text(second, of_intervals, numbers=range(1, 7)),
        )
    )


if __name__ == "__main__":
    title, _, about = (__doc__ or "").partition("\n")
    parser = argparse.ArgumentParser(description=title)
    parser.add_argument("--repetitions", type=int, default=200)
    parser.add_argument("--systems", nargs="*", choices=SYSTEMS, default=list(SYSTEMS))
    parser.add_argument("--write", action="store_true", help="put the tables into the page")
    chosen = parser.parse_args()
    text = tables(chosen.repetitions, chosen.systems)
    print(text)
    if chosen.write:
        about = about.strip().partition("\n\n")[2].partition("`--write`")[0]
        page = f"# Standard errors and intervals over {chosen.repetitions} repetitions\n\n"
        page += f"{about.strip()}\n\n```\n{text}\n```\n"
        (HERE / "coverage.md").write_text(page, encoding="utf-8")

"""Runs exported filters over a million samples in single precision, beside double precision.

    python benchmarks/mpc/long_filters.py [ROWS]

Says of each spec: samples that were not filtered, the smallest D of the covariance U D Uᵀ that ever
was, the smallest eigenvalue of the correlation matrix (1 where nothing is correlated; the rounding
of single precision is 6e-8), how far standard deviations and estimates are from those of double
precision, and microseconds a sample. The plants are simulated apart from the filter, with
parameters of their own and noise as the spec has it.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import msnn
from backends.c_language.literals import Dtype
from msnn.features.control.backend.write_estimator import write_estimator
from msnn.features.control.problem.state_estimation import EstimationProblem

HERE = Path(__file__).parent
Array = NDArray[np.float64]

EXACT = """
msnn: 1
name: exact
sample_time: 0.25 s
inputs: {u: {}}
states:
  p: {unit: m, next: p + 0.25 * v, init: p.meas}
  v: {next: v + 0.25 * u, init: v.meas}
outputs: {place: {expr: p, predicts: "p[t]"}}
estimator: {ekf: {measured: {place: 1e-5}, process: {p: 0.1, v: 0.4}, initial: {p: 1, v: 2}}}
"""
PENDULUM = """
msnn: 1
name: pendulum
sample_time: 0.05 s
inputs: {torque: {between: hold}}
parameters: {stiffness: {init: 6, min: 0}, damping: 0.3}
states:
  angle: {der: rate, init: angle.meas}
  rate: {der: -stiffness * sin(angle) - damping * rate + torque, init: rate.meas}
outputs: {seen: {expr: sin(angle), predicts: "shadow[t]"}}
targets: {shadow: {}}
estimator:
  ekf:
    measured: {seen: 0.02}
    process: {rate: 0.05}
    initial: {angle: 0.5, rate: 1}
    parameters: {stiffness: {std: 3, walk: 0, min: 1, max: 20}}
"""
PLACES = 12
_AROUND = [f"T{max(i - 1, 0)} - 2 * T{i} + T{min(i + 1, PLACES - 1)}" for i in range(PLACES)]
_INNER = "\n".join(
    f"  T{i}: {{der: 'k * ({_AROUND[i]}) - 0.01 * T{i}', init: 0}}" for i in range(1, PLACES)
)
HEAT = f"""
msnn: 1
name: heat
sample_time: 1 s
inputs: {{power: {{between: hold}}}}
parameters: {{k: {{init: 0.2, min: 0}}}}
states:
  T0: {{der: "k * ({_AROUND[0]}) - 0.01 * T0 + 0.1 * power", init: 0}}
{_INNER}
outputs: {{end: {{expr: 1 * T0, predicts: "near[t]"}}}}
targets: {{near: {{}}}}
estimator:
  ekf:
    measured: {{end: 0.01}}
    process: {{{", ".join(f"T{i}: 0.01" for i in range(PLACES))}}}
    initial: {{{", ".join(f"T{i}: 1" for i in range(PLACES))}}}
    parameters: {{k: {{std: 0.05, walk: 1e-6, min: 0.01}}}}
"""


@dataclass(frozen=True)
class Plant:
    """A spec with a filter, simulated measurements row by row, and the initial estimate."""

    text: str
    rows: Callable[[int], Array]
    start: tuple[float, ...]


def exact(count: int) -> Array:
    """Measurements of a body under changing forces, with almost no error."""
    random = np.random.default_rng(0)
    rows = np.empty((count, 2))
    p = v = 0.0
    for k in range(count):
        u = -0.3 * p - 0.5 * v
        rows[k] = u, p + 1e-5 * random.normal()
        p, v = p + 0.25 * v + 0.05 * random.normal(), v + 0.25 * u + 0.2 * random.normal()
    return rows


def pendulum(count: int) -> Array:
    """Measurements of a pendulum that is stiffer than its model; a fifth of the samples is
    missing.
    """
    random = np.random.default_rng(1)
    rows = np.empty((count, 2))
    angle, rate = 0.4, 0.0
    for k in range(count):
        torque = np.sin(0.07 * k)
        seen = np.sin(angle) + 0.02 * random.normal()
        rows[k] = torque, seen if random.uniform() > 0.2 else np.nan
        for _ in range(5):
            rate += 0.01 * (-9 * np.sin(angle) - 0.3 * rate + torque)
            angle += 0.01 * rate
    return rows


def heat(count: int) -> Array:
    """Measurements of a rod, heated and measured at one end: most states are hardly observable."""
    random = np.random.default_rng(2)
    rows = np.empty((count, 2))
    warm = np.zeros(PLACES)
    for k in range(count):
        power = np.sin(0.01 * k)
        rows[k] = power, warm[0] + 0.01 * random.normal()
        bend = np.diff(warm, prepend=warm[0], append=warm[-1])
        warm = warm + 0.25 * np.diff(bend) - 0.01 * warm + 0.01 * random.normal(size=PLACES)
        warm[0] += 0.1 * power
    return rows


PLANTS = {
    "exact": Plant(EXACT, exact, (0.0, 0.0)),
    "pendulum": Plant(PENDULUM, pendulum, (0.4, 0.0)),
    "heat": Plant(HEAT, heat, (0.0,) * PLACES),
}


def run(plant: Plant, rows: Array, dtype: Dtype) -> tuple[Array, float]:
    """Runs a filter over the rows in one precision; returns the lines of its output, and
    seconds.
    """
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        spec = folder / "spec.msnn.yaml"
        spec.write_text(plant.text, encoding="utf-8")
        model = msnn.load(spec)
        estimation = model.of(EstimationProblem)
        assert estimation is not None
        weights = msnn.initial_weights(model)
        write_estimator(estimation, weights, folder, prefix="plant", dtype=dtype)
        program = folder / "run"
        defined = {
            "HEADER": '"plant_ekf.h"',
            "PREFIX": "plant_ekf",
            "OF_REAL": "float" if dtype == "float32" else "double",
            "OF_ROWS": len(rows),
            "OF_INPUTS": 1,
            "OF_MEASURED": 1,
            "OF_STATES": len(plant.start),
        }
        command = ["gcc", "-std=c99", "-O2", "-ffp-contract=off", f"-I{folder / 'include'}"]
        command += [f"-D{name}={value}" for name, value in defined.items()]
        sources = [path for path in (folder / "src").glob("*.c") if "selftest" not in path.name]
        files = [HERE / "long_filters.c", *sources]
        subprocess.run([*command, *files, "-o", program, "-lm"], check=True)
        begun = time.perf_counter()
        start = [str(x) for x in plant.start]
        done = subprocess.run(
            [program, *start], input=rows.tobytes(), capture_output=True, check=True
        )
        seconds = time.perf_counter() - begun
    lines = done.stdout.decode().split("\n")
    return np.array([[float(word) for word in line.split()] for line in lines if line]), seconds


def covariances(lines: Array, size: int) -> Array:
    """The covariance U D Uᵀ of every line."""
    found = np.zeros((len(lines), size, size))
    upper = np.triu_indices(size)
    for number, line in enumerate(lines):
        factor = np.zeros((size, size))
        factor[upper] = line[3 + size :]
        U = np.triu(factor, 1) + np.eye(size)
        found[number] = (U * np.diagonal(factor)) @ U.T
    return found


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
    for name, plant in PLANTS.items():
        rows = plant.rows(count)
        single, seconds = run(plant, rows, "float32")
        double, _ = run(plant, rows, "float64")
        size = next(n for n in range(1, 99) if n + n * (n + 1) // 2 == single.shape[1] - 3)
        P, exact_P = covariances(single, size), covariances(double, size)
        std, exact_std = (np.sqrt(np.diagonal(m, axis1=1, axis2=2)) for m in (P, exact_P))
        correlation = P / (std[:, :, None] * std[:, None, :])
        off = np.abs(single[:, 3 : 3 + size] - double[:, 3 : 3 + size]) / exact_std
        print(
            f"{name}: {count:,} samples, {size} numbers, {int(single[-1, 1])} not filtered, "
            f"smallest D {single[-1, 2]:.2g} (double {double[-1, 2]:.2g}), "
            f"least eigenvalue of the correlation {np.linalg.eigvalsh(correlation).min():.2g}, "
            f"deviations off by {np.abs(std / exact_std - 1).max():.1e}, "
            f"estimates by {off.max():.1e} of them, {1e6 * seconds / count:.2f} µs"
        )


if __name__ == "__main__":
    main()

"""Defines the systems that the tools identify, in plain arithmetic that every tool accepts.

The other tools run this file in their own environments: it needs numpy and nothing of the project.
"""

from __future__ import annotations

import os
import resource
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

ROWS = 400
BEGAN = "CONTENDER_BEGAN"
"""Names the environment variable with the time at which a contender's process was started."""
NOISE = 0.01
"""Deviation of the noise of what is measured, as a share of that of the output."""


@dataclass(frozen=True)
class System:
    """The equations of a system, its true parameter values, and the error of the initial
    guesses.
    """

    derivatives: Callable[[Any, Sequence[Any], Any, Sequence[Any]], list[Any]]
    """Of a module with abs, sqrt, tanh and maximum, the states, the input and the parameters."""
    states: int
    output: int
    """Which state is measured."""
    true: dict[str, float]
    guesses: tuple[float, ...]
    """Times the true values."""
    sample_time: float
    amplitude: float
    offset: float = 0.0
    record: str = ""
    """The file of a real record, whose true values nobody knows: `true` are what is expected."""
    spec: str = ""
    """The states of the spec of msnn; parameters and the rest follow from the above."""


def duffing(m: Any, x: Sequence[Any], u: Any, p: Sequence[Any]) -> list[Any]:
    """A mass on a hardening spring."""
    damping, stiffness, hardening = p
    del m
    return [x[1], u - damping * x[1] - stiffness * x[0] - hardening * x[0] ** 3]


def van_der_pol(m: Any, x: Sequence[Any], u: Any, p: Sequence[Any]) -> list[Any]:
    """An oscillator whose damping is negative near 0."""
    growth, limit, stiffness = p
    del m
    return [x[1], u + growth * (1 - limit * x[0] ** 2) * x[1] - stiffness * x[0]]


def two_tanks(m: Any, x: Sequence[Any], u: Any, p: Sequence[Any]) -> list[Any]:
    """dx/dt of two tanks, one above the other; a part of the upper one's overflow is lost.

    `x` are the two levels, `u` the flow into the upper one, `p` the parameters. `m` is the module
    of the functions, such as `math` or `casadi`.
    """
    pump, upper, lower, overflow = p
    first, second = m.sqrt(m.maximum(x[0], 1e-3)), m.sqrt(m.maximum(x[1], 1e-3))
    over = m.maximum(x[0] - 1.0, 0.0)
    return [
        pump * u - upper * first - 5.0 * over,
        upper * first - lower * second + overflow * over,
    ]


def bouc_wen(m: Any, x: Sequence[Any], u: Any, p: Sequence[Any]) -> list[Any]:
    """A mass on a hysteretic spring, in units in which its frequency is near 1."""
    damping, stiffness, hysteresis, dissipation, hardening = p
    z = hysteresis * x[1] - dissipation * m.abs(x[1]) * x[2] - hardening * x[1] * m.abs(x[2])
    return [x[1], u - damping * x[1] - stiffness * x[0] - x[2], z]


def wiener_hammerstein(m: Any, x: Sequence[Any], u: Any, p: Sequence[Any]) -> list[Any]:
    """A resonant filter, a diode that reduces values above a threshold, and a slow filter."""
    frequency, ratio, knee, loss, corner = p
    bent = x[0] - loss * m.maximum(x[0] - knee, 0.0)
    return [
        x[1],
        frequency * frequency * (u - x[0]) - 2.0 * ratio * frequency * x[1],
        corner * (bent - x[2]),
    ]


def drone(m: Any, x: Sequence[Any], u: Any, p: Sequence[Any]) -> list[Any]:
    """An arm with a propeller: thrust, weight, dry friction, drag; angles in rad, u in percent."""
    gravity, thrust, friction, drag = p
    held = friction * m.tanh(x[1] / 0.05) + drag * x[1] * m.abs(x[1])
    return [x[1], thrust * u * u - gravity * m.sin(x[0]) - held]


SYSTEMS = {
    "duffing": System(
        duffing, 2, 0, {"damping": 0.3, "stiffness": 1.0, "hardening": 1.5}, (2.0, 0.7, 0.5),
        0.1, 1.5,
        spec="x: {der: v, init: 0}\n"
        "  v: {der: u - damping*v - stiffness*x - hardening*x**3, init: 0}",
    ),
    "van_der_pol": System(
        van_der_pol, 2, 0, {"growth": 1.0, "limit": 1.0, "stiffness": 1.0}, (0.7, 1.4, 0.8),
        0.1, 2.0,
        spec="x: {der: v, init: 0}\n"
        "  v: {der: u + growth*(1 - limit*x**2)*v - stiffness*x, init: 0}",
    ),
    "two_tanks": System(
        two_tanks, 2, 1, {"pump": 0.5, "upper": 0.4, "lower": 0.35, "overflow": 2.0},
        (0.7, 1.4, 1.3, 0.5), 0.1, 1.0, offset=0.8,
        spec="x: {der: 'pump*u - upper*sqrt(max(x, 0.001)) - 5*max(x - 1, 0)', init: 0}\n"
        "  w: {der: 'upper*sqrt(max(x, 0.001)) - lower*sqrt(max(w, 0.001))"
        " + overflow*max(x - 1, 0)', init: 0}",
    ),
    "bouc_wen": System(
        bouc_wen, 3, 0,
        {"damping": 0.1, "stiffness": 0.5, "hysteresis": 0.6, "dissipation": 0.8,
         "hardening": -0.5},
        (2.0, 0.8, 1.3, 0.7, 1.3), 0.1, 1.5,
        spec="x: {der: v, init: 0}\n  v: {der: u - damping*v - stiffness*x - z, init: 0}\n"
        "  z: {der: hysteresis*v - dissipation*abs(v)*z - hardening*v*abs(z), init: 0}",
    ),
    "wiener_hammerstein": System(
        wiener_hammerstein, 3, 2,
        {"frequency": 2.0, "ratio": 0.4, "knee": 0.3, "loss": 0.7, "corner": 1.0},
        (0.8, 1.5, 1.5, 0.7, 1.4), 0.1, 1.5,
        spec="x: {der: v, init: 0}\n"
        "  v: {der: frequency**2*(u - x) - 2*ratio*frequency*v, init: 0}\n"
        "  w: {der: 'corner*(x - loss*max(x - knee, 0) - w)', init: 0}",
    ),
    "quarter_drone": System(
        drone, 2, 0, {"gravity": 9.0, "thrust": 4.6e-3, "friction": 0.5, "drag": 0.5},
        (1.1, 1.1, 0.6, 1.0), 0.05, 0.0, record="sinal4_multiseno_malha_fechada.csv",
        spec="x: {der: v, init: y.meas}\n"
        "  v: {der: thrust*u**2 - gravity*sin(x) - friction*tanh(v/0.05) - drag*v*abs(v), init: 0}",
    ),
}  # fmt: skip


def step(
    system: System, m: Any, x: Sequence[Any], u: Any, p: Sequence[Any], dt: float
) -> list[Any]:
    """One Runge-Kutta step of order 4 with constant input, which every tool uses."""
    first = system.derivatives(m, x, u, p)
    second = system.derivatives(m, [a + dt / 2 * b for a, b in zip(x, first, strict=True)], u, p)
    third = system.derivatives(m, [a + dt / 2 * b for a, b in zip(x, second, strict=True)], u, p)
    last = system.derivatives(m, [a + dt * b for a, b in zip(x, third, strict=True)], u, p)
    return [
        a + dt / 6 * (b + 2 * c + 2 * d + e)
        for a, b, c, d, e in zip(x, first, second, third, last, strict=True)
    ]


def measured_records(file: Path) -> dict[str, np.ndarray]:
    """The measured recording of the drone: 20 to 80 s, every fifth sample, 3/5 to train and 2/5 to
    test.

    The command is the median of three samples, which removes spikes. "Clean" is the measurement
    itself, so that the table has an error; one degree counts as noise.
    """
    time, _, angle, command = np.loadtxt(file, delimiter=",", skiprows=1).T
    kept = (time >= 20.0) & (time <= 80.0)
    y, raw = np.radians(angle[kept][::5]), command[kept][::5]
    before = np.concatenate([raw[:1], raw[:1], raw])
    u = np.median([before[2:], before[1:-1], before[:-2]], axis=0)
    cut = len(y) * 3 // 5
    found: dict[str, np.ndarray] = {}
    for name, part in (("train", slice(0, cut)), ("test", slice(cut, None))):
        found |= {f"{name}_u": u[part], f"{name}_y": y[part], f"{name}_clean": y[part]}
        found[f"{name}_x0"] = np.array([y[part][0], 0.0])
    found["train_clean"] = found["train_y"] - np.radians(1.0)
    return found


def records(system: System, seed: int) -> dict[str, np.ndarray]:
    """Input, measured output and output without noise of a record to train on and one to test on.

    From rest, with 16 steps a sample, under steps of random height and length.
    """
    random = np.random.default_rng(seed)
    found: dict[str, np.ndarray] = {}
    for name in ("train", "test"):
        u = np.repeat(random.uniform(-1, 1, ROWS), random.integers(3, 15, ROWS))[:ROWS]
        u = system.offset + system.amplitude * u
        x, outputs = [0.0] * system.states, np.empty(ROWS)
        for t in range(ROWS):
            outputs[t] = x[system.output]
            for _ in range(16):
                x = step(system, np, x, u[t], list(system.true.values()), system.sample_time / 16)
        noise = NOISE * np.std(outputs) * random.normal(size=ROWS)
        found |= {f"{name}_u": u, f"{name}_y": outputs + noise, f"{name}_clean": outputs}
        found[f"{name}_x0"] = np.zeros(system.states)
    return found


def processor_seconds() -> float:
    """CPU seconds of this process and of those that it waited for."""
    both = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(each.ru_utime + each.ru_stime for each in both)


def beginning(fit: int) -> tuple[float, float]:
    """The clock and the CPU seconds at which a fit begins; the first fit begins with its
    process.
    """
    now = time.perf_counter()
    if fit:
        return now, processor_seconds()
    return now - (time.time() - float(os.environ[BEGAN])), 0.0


def first_values(system: System) -> np.ndarray:
    """The initial guesses of the parameters, the same for every tool."""
    return np.array(list(system.true.values())) * np.array(system.guesses)

"""Simulates systems whose inputs, delays, time constants and feedback are known."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import signal

Array = NDArray[np.float64]
_scipy: Any = signal
"""Its functions have no types of their own."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One recording: a target, its inputs, and the truth about them."""

    target: Array
    inputs: Array
    """(rows, inputs)"""
    acts: tuple[bool, ...]
    """True for each input that influences the target."""
    constant: float | None = None
    """The slowest time constant in rows; infinite for an integrator."""
    delay: int | None = None
    """Delay of the first input in rows."""
    feedback: bool = False


def steps(random: np.random.Generator, rows: int, least: int = 6, most: int = 30) -> Array:
    """Steps of random height and length."""
    lengths = random.integers(least, most + 1, rows // least + 1)
    return np.repeat(random.uniform(-1, 1, len(lengths)), lengths)[:rows]


def filtered(numerator: list[float], denominator: list[float], u: Array) -> Array:
    """The filter numerator/denominator, in powers of q⁻¹, from rest."""
    return np.asarray(_scipy.lfilter(numerator, denominator, u), dtype=np.float64)


def _late(u: Array, delay: int) -> Array:
    return np.concatenate((np.zeros(delay), u))[: len(u)]


def _with(noise: Array, y: Array, share: float) -> Array:
    return y + noise * (share * np.std(y) / np.std(noise))


def _first_order(random: np.random.Generator, constant: float = 20.0, delay: int = 1) -> Case:
    u, a = steps(random, 2_000), math.exp(-1 / constant)
    y = filtered([1 - a], [1, -a], _late(u, delay))
    y = _with(random.normal(size=len(u)), y, 0.1)
    return Case(target=y, inputs=u[:, None], acts=(True,), constant=constant, delay=delay)


def _resonance(random: np.random.Generator) -> Case:
    u, pole = random.normal(size=2_000), np.exp(-1 / 29 + 2j * np.pi / 9)
    y = filtered([1.0], [1, -2 * pole.real, abs(pole) ** 2], _late(u, 1))
    y = _with(random.normal(size=len(u)), y, 0.2)
    return Case(target=y, inputs=u[:, None], acts=(True,), constant=29.0, delay=1)


def _oscillator(random: np.random.Generator) -> Case:
    u = np.repeat(random.uniform(-1, 1, 20), 25)
    x = v = 0.0
    y = np.zeros(500)
    for t in range(500):
        y[t] = x + random.normal(0, 0.1)
        v += 0.1 * (u[t] - x) - 0.3 * v
        x += 0.3 * v
    # of x and v: their matrix has the eigenvalues |z|² = 0.7
    return Case(target=y, inputs=u[:, None], acts=(True,), constant=-2 / math.log(0.7))


def _integrator(random: np.random.Generator) -> Case:
    u = steps(random, 2_000)
    y = np.cumsum(_late(u, 1))
    y = _with(random.normal(size=len(u)), y, 0.01)
    return Case(target=y, inputs=u[:, None], acts=(True,), constant=math.inf, delay=1)


def _one_dead(random: np.random.Generator) -> Case:
    u, w, a = steps(random, 2_000), steps(random, 2_000), math.exp(-1 / 15)
    y = _with(random.normal(size=len(u)), filtered([1 - a], [1, -a], _late(u, 2)), 0.1)
    return Case(target=y, inputs=np.stack((u, w), 1), acts=(True, False), constant=15.0, delay=2)


def _quantised(random: np.random.Generator) -> Case:
    case = _first_order(random)
    step = 0.1 * np.std(case.target)
    return Case(
        target=np.round(case.target / step) * step,
        inputs=case.inputs,
        acts=(True,),
        constant=20.0,
        delay=1,
    )


def _coloured(random: np.random.Generator) -> Case:
    u, a = steps(random, 2_000), math.exp(-1 / 20)
    y = filtered([1 - a], [1, -a], _late(u, 1))
    noise = filtered([1.0], [1, -0.95], random.normal(size=len(u)))
    return Case(
        target=_with(noise, y, 0.3), inputs=u[:, None], acts=(True,), constant=20.0, delay=1
    )


def _drift(random: np.random.Generator) -> Case:
    case = _first_order(random)
    drift = np.cumsum(random.normal(size=len(case.target)))
    return Case(target=_with(drift, case.target, 0.5), inputs=case.inputs, acts=(True,), delay=1)


def _closed_loop(random: np.random.Generator, *, late: int, integral: float) -> Case:
    rows = 3_000
    reference, y, u, total = steps(random, rows, 30, 90), np.zeros(rows), np.zeros(rows), 0.0
    for t in range(1, rows):
        y[t] = 0.9 * y[t - 1] + 0.1 * u[t - 1] + 0.02 * random.normal()
        error = reference[t] - y[t - late]
        total += integral * error
        u[t] = 2 * error + total
    return Case(
        target=y,
        inputs=np.stack((u, reference), 1),
        acts=(True, False),
        constant=-1 / math.log(0.9),
        delay=1,
        feedback=True,
    )


def _two_modes(random: np.random.Generator) -> Case:
    u = steps(random, 4_000)
    slow, fast = math.exp(-1 / 100), math.exp(-1 / 8)
    y = 0.6 * filtered([1 - slow], [1, -slow], _late(u, 1))
    y += 0.4 * filtered([1 - fast], [1, -fast], _late(u, 1))
    y = _with(random.normal(size=len(u)), y, 0.05)
    return Case(target=y, inputs=u[:, None], acts=(True,), constant=100.0, delay=1)


def _nonlinear(random: np.random.Generator) -> Case:
    u, y = steps(random, 2_000), np.zeros(2_000)
    for t in range(1, 2_000):
        y[t] = 0.9 * y[t - 1] - 0.1 * y[t - 1] ** 3 + 0.2 * u[t - 1] + 0.01 * random.normal()
    return Case(target=y, inputs=u[:, None], acts=(True,), delay=1)


SYSTEMS: Mapping[str, Callable[[np.random.Generator], Case]] = {
    "first order": _first_order,
    "delay of 20 samples": lambda random: _first_order(random, delay=20),
    "slow, 80 samples": lambda random: _first_order(random, constant=80.0),
    "resonance, Q = 10": _resonance,
    "oscillator, 500 samples": _oscillator,
    "integrator": _integrator,
    "two inputs, one dead": _one_dead,
    "quantised": _quantised,
    "coloured noise": _coloured,
    "drift": _drift,
    "proportional controller, same row": lambda random: _closed_loop(random, late=0, integral=0.0),
    "proportional controller, next row": lambda random: _closed_loop(random, late=1, integral=0.0),
    "integrating controller, same row": lambda random: _closed_loop(random, late=0, integral=0.05),
    "integrating controller, next row": lambda random: _closed_loop(random, late=1, integral=0.05),
    "two modes": _two_modes,
    "nonlinear": _nonlinear,
}
"""Recordings with at least one input that acts."""


def _noise(kind: str, random: np.random.Generator, rows: int) -> Array:
    e = random.normal(size=rows + 200)
    match kind:
        case "white":
            found = e
        case "AR(1) 0.95":
            found = filtered([1.0], [1, -0.95], e)
        case "random walk":
            found = np.cumsum(e)
        case "walk + white":
            found = np.cumsum(0.1 * e) + random.normal(size=len(e))
        case "MA(4)":
            found = filtered([1, 0.8, 0.6, 0.3], [1.0], e)
        case "resonance":
            found = filtered([1.0], [1, -1.8, 0.97], e)
        case _:
            raise AssertionError(kind)
    return found[200:]


NULLS: tuple[tuple[str, str, int], ...] = (
    ("white", "steps", 400),
    ("white", "white", 2_000),
    ("AR(1) 0.95", "steps", 400),
    ("AR(1) 0.95", "random walk", 1_000),
    ("random walk", "steps", 1_000),
    ("random walk", "random walk", 1_000),
    ("walk + white", "steps", 1_000),
    ("MA(4)", "steps", 400),
    ("MA(4)", "AR(1)", 1_000),
    ("resonance", "steps", 1_000),
    ("white, louder with u", "steps", 1_000),
    ("AR(1) under feedback", "controller, same row", 1_000),
    ("AR(1) under feedback", "controller, next row", 1_000),
)
"""Noise of the target, kind of the input, rows: recordings without an influence of the input."""


def null_case(noise: str, input: str, rows: int, random: np.random.Generator) -> Case:
    """A target that its input does not influence."""
    if noise.endswith("feedback"):
        y = filtered([1.0], [1, -0.9], random.normal(size=rows))
        reference = steps(random, rows, 30, 90)
        u = 2 * (reference - _late(y, 0 if input.endswith("same row") else 1))
        return Case(target=y, inputs=u[:, None], acts=(False,), feedback=True)
    match input:
        case "steps":
            u = steps(random, rows)
        case "white":
            u = random.normal(size=rows)
        case "random walk":
            u = np.cumsum(random.normal(size=rows))
        case "AR(1)":
            u = filtered([1.0], [1, -0.9], random.normal(size=rows))
        case _:
            raise AssertionError(input)
    if noise.endswith("with u"):
        y = random.normal(size=rows) * (0.2 + np.abs(u))
    else:
        y = _noise(noise, random, rows)
    return Case(target=y, inputs=u[:, None], acts=(False,))

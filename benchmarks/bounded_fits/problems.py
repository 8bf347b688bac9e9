"""Least-squares problems with bounds: NIST's models with their data, static laws, ODE fits.

Each problem is there twice, with its minimum inside the bounds and with a bound that cuts the
minimum off, from five initial points each: two near ones, two that are wrong by factors between 2
and 100, and one with a parameter on its bound.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Numbers = NDArray[Any]
"""Real, or complex where derivatives are taken."""
Law = Callable[[Sequence[Numbers], Array], Numbers]
"""(parameters, each (..., 1), input (rows)) → predictions (..., rows)."""
Model = Callable[[Numbers], Numbers]
"""(..., n, 1) → (..., rows)."""

STEP = 1e-30
"""Of the complex-step derivative: its square is nothing beside 1."""


@dataclass(frozen=True, kw_only=True)
class Problem:
    """A sum of squares over a box, with initial points."""

    name: str
    model: Model
    target: Array
    low: Array
    high: Array
    points: tuple[Array, ...]
    known: Array
    """A good point without the bounds."""
    on_bound: bool = False

    def residual(self, x: Array) -> Array:
        """Predictions minus data at the parameters x; NaN where the model is undefined."""
        with np.errstate(all="ignore"):
            return np.real(self.model(np.asarray(x, float)[:, None])) - self.target

    def jacobian(self, x: Array) -> Array:
        """∂ residual/∂ x, (rows, n), exact to rounding (Squire, Trapp 1998)."""
        moved = np.asarray(x, complex) + 1j * STEP * np.eye(len(x))
        with np.errstate(all="ignore"):
            found = np.imag(self.model(moved[..., None])).T / STEP
        return np.broadcast_to(found, (len(self.target), len(x)))

    def loss(self, x: Array) -> float:
        """The mean square of the residuals at the parameters x."""
        found = self.residual(x)
        return float(found @ found) / len(found)


def root(value: Numbers) -> Numbers:
    """The square root; NaN for negative numbers."""
    return np.where(np.real(value) < 0.0, np.nan, np.sqrt(value))


def _gauss(b: Sequence[Numbers], x: Array) -> Numbers:
    first = b[2] * np.exp(-((x - b[3]) ** 2) / b[4] ** 2)
    return b[0] * np.exp(-b[1] * x) + first + b[5] * np.exp(-((x - b[6]) ** 2) / b[7] ** 2)


def _cubics(b: Sequence[Numbers], x: Array) -> Numbers:
    above = b[0] + b[1] * x + b[2] * x**2 + b[3] * x**3
    return above / (1 + b[4] * x + b[5] * x**2 + b[6] * x**3)


def _exponentials(b: Sequence[Numbers], x: Array) -> Numbers:
    return b[0] * np.exp(-b[1] * x) + b[2] * np.exp(-b[3] * x) + b[4] * np.exp(-b[5] * x)


def _power(base: Numbers, exponent: Numbers) -> Numbers:
    return np.where(np.real(base) < 0.0, np.nan, base**exponent)


def _cycles(b: Sequence[Numbers], x: Array) -> Numbers:
    turn = 2 * np.pi * x
    found = b[0] + b[1] * np.cos(turn / 12) + b[2] * np.sin(turn / 12)
    found = found + b[4] * np.cos(turn / b[3]) + b[5] * np.sin(turn / b[3])
    return found + b[7] * np.cos(turn / b[6]) + b[8] * np.sin(turn / b[6])


NIST: dict[str, Law] = {
    "Bennett5": lambda b, x: b[0] * _power(b[1] + x, -1 / b[2]),
    "BoxBOD": lambda b, x: b[0] * (1 - np.exp(-b[1] * x)),
    "Chwirut1": lambda b, x: np.exp(-b[0] * x) / (b[1] + b[2] * x),
    "Chwirut2": lambda b, x: np.exp(-b[0] * x) / (b[1] + b[2] * x),
    "DanWood": lambda b, x: b[0] * x ** b[1],
    "ENSO": _cycles,
    "Eckerle4": lambda b, x: b[0] / b[1] * np.exp(-0.5 * ((x - b[2]) / b[1]) ** 2),
    "Gauss1": _gauss,
    "Gauss2": _gauss,
    "Gauss3": _gauss,
    "Hahn1": _cubics,
    "Kirby2": lambda b, x: (b[0] + b[1] * x + b[2] * x**2) / (1 + b[3] * x + b[4] * x**2),
    "Lanczos1": _exponentials,
    "Lanczos2": _exponentials,
    "Lanczos3": _exponentials,
    "MGH09": lambda b, x: b[0] * (x**2 + x * b[1]) / (x**2 + x * b[2] + b[3]),
    "MGH10": lambda b, x: b[0] * np.exp(b[1] / (x + b[2])),
    "MGH17": lambda b, x: b[0] + b[1] * np.exp(-x * b[3]) + b[2] * np.exp(-x * b[4]),
    "Misra1a": lambda b, x: b[0] * (1 - np.exp(-b[1] * x)),
    "Misra1b": lambda b, x: b[0] * (1 - (1 + b[1] * x / 2) ** -2.0),
    "Misra1c": lambda b, x: b[0] * (1 - 1 / root(1 + 2 * b[1] * x)),
    "Misra1d": lambda b, x: b[0] * b[1] * x / (1 + b[1] * x),
    "Rat42": lambda b, x: b[0] / (1 + np.exp(b[1] - b[2] * x)),
    "Rat43": lambda b, x: b[0] / (1 + np.exp(b[1] - b[2] * x)) ** (1 / b[3]),
    "Roszman1": lambda b, x: b[0] - b[1] * x - np.arctan(b[2] / (x - b[3])) / np.pi,
    "Thurber": _cubics,
}


def _tables() -> dict[str, dict[str, Array]]:
    tables: dict[str, dict[str, Array]] = {}
    text = (Path(__file__).resolve().parent / "nist_strd.txt").read_text(encoding="utf-8")
    for block in text.split("\n[")[1:]:
        name, _, content = block.partition("]\n")
        pairs = (line.split(":") for line in content.replace("\n  ", " ").splitlines() if line)
        tables[name] = {key: np.array(values.split(), float) for key, values in pairs}
    return tables


def _nist() -> list[Problem]:
    found: list[Problem] = []
    for name, one in _tables().items():
        points = np.stack([one["start_1"], one["start_2"], one["certified"]])
        least, most = points.min(axis=0), points.max(axis=0)
        room = np.maximum(most - least, np.abs(points).max(axis=0))
        low = np.where(least > 0, 0.0, least - room)
        high = np.where(most < 0, 0.0, most + np.where(least > 0, 4 * most, room))
        if name == "Nelson":
            x1, x2, target = one["x"], one["x2"], np.log(one["y"])

            def model(b: Numbers, x1: Array = x1, x2: Array = x2) -> Numbers:
                first, second, third = np.moveaxis(b, -2, 0)
                return first - second * x1 * np.exp(-third * x2)
        else:
            target = one["y"]

            def model(b: Numbers, law: Law = NIST[name], x: Array = one["x"]) -> Numbers:
                return law(list(np.moveaxis(b, -2, 0)), x)

        found.append(
            Problem(
                name=name,
                model=model,
                target=target,
                low=low,
                high=high,
                points=(points[0], points[1]),
                known=points[2],
            )
        )
    return found


# ---- laws of one input: name → (law, true values, low, high, range of the input)
_LAWS: dict[str, tuple[Law, list[float], list[float], list[float], tuple[float, float]]] = {
    "michaelis_menten": (
        lambda b, x: b[0] * x / (b[1] + x), [2.0, 0.3], [0, 0], [50, 20], (0.02, 3)),
    "hill": (
        lambda b, x: b[0] * x ** b[2] / (b[1] ** b[2] + x ** b[2]),
        [1.5, 0.8, 2.5], [0, 0.01, 0.5], [20, 10, 8], (0.05, 4)),
    "arrhenius": (
        lambda b, x: b[0] * np.exp(-b[1] / x), [3.0, 4.0], [0, 0], [1000, 50], (1, 4)),
    "langmuir_two_sites": (
        lambda b, x: b[0] * b[1] * x / (1 + b[1] * x) + b[2] * b[3] * x / (1 + b[3] * x),
        [1.0, 9.0, 2.0, 0.3], [0, 0, 0, 0], [20, 200, 20, 20], (0.01, 10)),
    "stribeck": (
        lambda b, x: (b[0] + b[1] * np.exp(-((x / b[2]) ** 2))) * np.tanh(200 * x) + b[3] * x,
        [1.2, 0.8, 0.05, 2.0], [0, 0, 0.002, 0], [10, 10, 1, 50], (-0.4, 0.4)),
    "saturation": (
        lambda b, x: b[0] * np.tanh(x / b[1]) + b[2] * x,
        [1.4, 0.7, 0.02], [0, 0.01, 0], [20, 20, 2], (-3, 3)),
    "antoine": (
        lambda b, x: b[0] - b[1] / (x + b[2]), [8.0, 1700.0, 230.0], [0, 0, 50], [50, 9000, 900],
        (5, 120)),
    "decay_and_offset": (
        lambda b, x: b[0] * np.exp(-x / b[1]) + b[2], [5.0, 0.6, 1.0], [0, 0.001, 0], [99, 60, 30],
        (0, 4)),
    "resonance": (
        lambda b, x: b[0] / root((b[1] ** 2 - x**2) ** 2 + (2 * b[2] * b[1] * x) ** 2),
        [3.0, 2.0, 0.05], [0, 0.1, 0.001], [60, 20, 1], (0.3, 5)),
    "logistic": (
        lambda b, x: b[0] / (1 + np.exp(-b[1] * (x - b[2]))), [4.0, 2.0, 3.0], [0, 0, 0],
        [99, 60, 30], (0, 6)),
}  # fmt: skip


def _laws() -> list[Problem]:
    found: list[Problem] = []
    for number, (name, (law, true, low, high, (first, last))) in enumerate(_LAWS.items()):
        random = np.random.Generator(np.random.Philox(100 + number))
        x = np.linspace(first, last, 60)

        def model(b: Numbers, law: Law = law, x: Array = x) -> Numbers:
            return law(list(np.moveaxis(b, -2, 0)), x)

        found.append(_with_noise(name, model, true, low, high, random))
    return found


# ---- differential equations: name → (ẋ(x, u, b), x(0), output, true values, low, high, samples)
Slope = Callable[[Sequence[Numbers], float, Sequence[Numbers]], list[Numbers]]
_EQUATIONS: dict[str, tuple[Slope, list[float], int, list[float], list[float], list[float]]] = {
    "decay_chain": (
        lambda x, u, b: [-b[0] * x[0], b[0] * x[0] - b[1] * x[1]], [1.0, 0.0], 1,
        [1.5, 0.4], [0, 0], [50, 50]),
    "oscillator": (
        lambda x, u, b: [x[1], (u - b[1] * x[1] - b[2] * x[0]) / b[0]], [0.0, 0.0], 0,
        [1.3, 0.4, 6.0], [0.05, 0, 0], [20, 20, 100]),
    "duffing": (
        lambda x, u, b: [x[1], u - b[0] * x[1] - b[1] * x[0] - b[2] * x[0] ** 3], [0.0, 0.0], 0,
        [0.3, 1.0, 2.0], [0, 0, 0], [10, 40, 60]),
    "lotka_volterra": (
        lambda x, u, b: [x[0] * (b[0] - b[1] * x[1]), x[1] * (b[2] * x[0] - b[3])], [1.0, 0.5], 0,
        [1.0, 0.8, 0.7, 0.9], [0, 0, 0, 0], [8, 8, 8, 8]),
    "monod": (
        lambda x, u, b: [
            b[0] * x[1] / (b[1] + x[1]) * x[0], -b[0] * x[1] / (b[1] + x[1]) * x[0] / b[2]],
        [0.1, 2.0], 0, [1.1, 0.4, 0.5], [0, 0.001, 0.02], [10, 10, 5]),
    "tank": (
        lambda x, u, b: [b[0] * (u + 1.2) - b[1] * root(x[0])], [1.0], 0, [0.8, 0.9], [0, 0],
        [20, 20]),
    "two_tanks": (
        lambda x, u, b: [
            b[0] * (u + 1.2) - b[1] * root(x[0]), b[1] * root(x[0]) - b[2] * root(x[1])],
        [1.0, 1.0], 1, [0.8, 0.9, 1.1], [0, 0, 0], [20, 20, 20]),
    "two_masses_of_heat": (
        lambda x, u, b: [b[0] * u - b[1] * (x[0] - x[1]), b[2] * (x[0] - x[1]) - b[3] * x[1]],
        [0.0, 0.0], 0, [2.0, 1.0, 0.5, 0.1], [0, 0, 0, 0], [40, 20, 20, 10]),
    "van_der_pol": (
        lambda x, u, b: [x[1], b[0] * (1 - x[0] ** 2) * x[1] - b[1] * x[0] + 0 * u], [1.0, 0.0], 0,
        [0.8, 1.2], [0, 0], [6, 12]),
    "motor": (
        lambda x, u, b: [(u - b[0] * x[0] - b[1] * x[1]) / b[2], (b[1] * x[0] - b[3] * x[1]) / 0.2],
        [0.0, 0.0], 1, [0.9, 0.5, 0.3, 0.1], [0, 0, 0.02, 0], [20, 10, 10, 5]),
}  # fmt: skip
_HOUR, _PARTS, _ROWS = 0.1, 2, 100


def _equations() -> list[Problem]:
    found: list[Problem] = []
    for number, (name, (slope, start, seen, true, low, high)) in enumerate(_EQUATIONS.items()):
        random = np.random.Generator(np.random.Philox(200 + number))
        force = np.repeat(random.uniform(-1, 1, _ROWS // 10), 10)

        def model(
            b: Numbers,
            slope: Slope = slope,
            start: list[float] = start,
            seen: int = seen,
            force: Array = force,
        ) -> Numbers:
            parameters = list(np.moveaxis(b, -2, 0)[..., 0])
            x = np.stack([np.full(b.shape[:-2], one, b.dtype) for one in start])
            rows: list[Numbers] = []
            h = _HOUR / _PARTS
            for u in force.tolist():
                rows.append(x[seen])
                for _ in range(_PARTS):
                    k1 = np.stack(slope(x, u, parameters))
                    k2 = np.stack(slope(x + h / 2 * k1, u, parameters))
                    k3 = np.stack(slope(x + h / 2 * k2, u, parameters))
                    k4 = np.stack(slope(x + h * k3, u, parameters))
                    x = x + h / 6 * (k1 + 2 * (k2 + k3) + k4)
            return np.stack(rows, axis=-1)

        found.append(_with_noise(name, model, true, low, high, random))
    return found


def _with_noise(
    name: str,
    model: Model,
    true: list[float],
    low: list[float],
    high: list[float],
    random: np.random.Generator,
) -> Problem:
    """The problem with 2 % of noise on the data; its near initial points are wrong by 1.5 and 4."""
    values = np.array(true)
    exact = np.real(model(values[:, None]))
    noise = 0.02 * np.std(exact) * random.normal(size=exact.shape)
    ends = np.array(low, float), np.array(high, float)
    near = (values * factor ** random.choice([-1.0, 1.0], len(values)) for factor in (1.5, 4.0))
    return Problem(
        name=name,
        model=model,
        target=exact + noise,
        low=ends[0],
        high=ends[1],
        points=tuple(np.clip(one, *ends) for one in near),
        known=values,
    )


def problems() -> list[Problem]:
    """All problems, each with its five initial points."""
    found: list[Problem] = []
    for number, one in enumerate((*_nist(), *_laws(), *_equations())):
        random = np.random.Generator(np.random.Philox(number))
        found.append(_with_points(one, random))
        found.append(_with_points(_cut(one, random), random))
    return found


def _cut(problem: Problem, random: np.random.Generator) -> Problem:
    """The problem with a bound between the minimum and an initial point of one parameter."""
    which = int(random.integers(len(problem.known)))
    at, towards = problem.known[which], problem.points[0][which]
    bound = at + 0.3 * (towards - at)
    if towards == at:
        bound = at * 1.2
    low, high = problem.low.copy(), problem.high.copy()
    (low if bound > at else high)[which] = bound
    name = f"{problem.name}, b{which + 1} {'>' if bound > at else '<'} {bound:.4g}"
    return replace(problem, name=name, low=low, high=high, on_bound=True)


def _with_points(problem: Problem, random: np.random.Generator) -> Problem:
    """The problem with five initial points: near its own, two far from it, and one on a bound."""
    low, high = problem.low, problem.high
    inner = 1e-3 * (high - low)
    near = tuple(np.clip(one, low + inner, high - inner) for one in problem.points)
    far = [far_point(problem, near[0], random) for _ in range(2)]
    on = near[1]
    for _ in range(100):
        which, side = int(random.integers(len(low))), int(random.integers(2))
        trial = near[1].copy()
        trial[which] = (low, high)[side][which]
        jacobian = problem.jacobian(trial)
        if np.isfinite(problem.loss(trial)) and np.isfinite(jacobian).all():
            on = trial
            break
    return replace(problem, points=(*near, *far, on))


def far_point(problem: Problem, near: Array, random: np.random.Generator) -> Array:
    """A point with factors of up to 100, at which the loss is finite."""
    inner = 1e-3 * (problem.high - problem.low)
    for _ in range(100):
        factors = random.uniform(np.log(2), np.log(100)) * random.uniform(-1, 1, len(near))
        trial = np.clip(near * np.exp(factors), problem.low + inner, problem.high - inner)
        if np.isfinite(problem.loss(trial)):
            return trial
    return near

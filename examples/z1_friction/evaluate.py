"""Measures the learned friction beside its baselines: rollouts of 0.5 s over the test episodes.

Every model moves the same rigid bodies by the same integrator, the one of the spec; they differ in
the friction that they subtract. Each rollout starts from measured, noisy positions and speeds. The
errors are kept in `runs/errors.json`, how many
numbers were learned in `runs/numbers.json`.

    python evaluate.py [--weights runs/z1_friction/latest/weights.safetensors]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import results
import truth
from numpy.typing import NDArray
from safetensors.numpy import load_file

from compiler.interpreter.interpreter import Interpreter
from msnn.model.load import load_model

Array = NDArray[np.float64]
Episode = dict[str, Array]
Friction = Callable[[Array, Array], Array]

HERE = Path(__file__).parent
HORIZON, SUBSTEPS, SAMPLE_TIME = 50, 2, 0.01
SHARPNESS = 20.0


class Bodies:
    """Mass matrices and bias torques of many configurations at once."""

    def __init__(self) -> None:
        self._interpreter = Interpreter(load_model(HERE / "bodies.msnn.yaml").program)

    def at(self, q: Array, dq: Array) -> tuple[Array, Array]:
        rows = np.arange(len(q))
        log = {"q": q, "dq": dq}
        found = self._interpreter.step(log, rows, self._interpreter.start(log, rows)).outputs
        return found["M"], found["bias"]


@dataclass(frozen=True)
class Windows:
    """Rollouts that begin at measured states: torques and positions (steps, rollouts, 6)."""

    q0: Array
    dq0: Array
    tau: Array
    q: Array
    """Measured, at the end of each step."""
    dq: Array


def episodes(split: str) -> list[Episode]:
    """Torques, positions and speeds of each file."""
    found: list[Episode] = []
    for file in sorted((HERE / "data" / split).glob("*.csv")):
        rows = np.loadtxt(file, delimiter=",", skiprows=1)
        found.append({"tau": rows[:, 1:7], "q": rows[:, 7:13], "dq": rows[:, 13:19]})
    return found


def windows(of: Sequence[Episode], stride: int = HORIZON) -> Windows:
    """The rollouts of these episodes, so many samples apart."""
    starts = [(e, s) for e in of for s in range(0, len(e["q"]) - HORIZON, stride)]
    steps = np.arange(HORIZON)

    def along(name: str, ahead: int) -> Array:
        return np.stack([e[name][s + ahead + steps] for e, s in starts], axis=1)

    q0, dq0 = (np.array([e[name][s] for e, s in starts]) for name in ("q", "dq"))
    return Windows(q0, dq0, along("tau", 0), along("q", 1), along("dq", 1))


def learned(file: Path) -> Friction:
    """The friction of the spec with trained weights."""
    C = load_file(file)

    def coefficient(name: str, q: Array) -> Array:
        basis = np.stack([np.ones_like(q), np.sin(q), np.cos(q)], axis=-1)
        return np.logaddexp(0.0, np.sum(C[name] * basis, axis=-1))

    def friction(q: Array, dq: Array) -> Array:
        viscous, coulomb, static, speed = (coefficient(f"C_{c}", q) for c in "vcsw")
        rise = (static - coulomb) * np.exp(-((dq / speed) ** 2))
        return viscous * dq + np.tanh(dq / C["w_0"]) * (coulomb + rise)

    return friction


def regression(bodies: Bodies, of: Sequence[Episode], *, full: bool) -> Friction:
    """Least squares of viscous and Coulomb friction; `full` has 1, sin q and cos q of each.

    The torques come from differences of measured speeds, as accelerations are not measured.
    """
    q, dq, torque = (
        np.concatenate(parts) for parts in zip(*map(_residuals(bodies), of), strict=True)
    )
    weights = [
        np.linalg.lstsq(_terms(q[:, j], dq[:, j], full), torque[:, j], rcond=None)[0]
        for j in range(6)
    ]

    def friction(q: Array, dq: Array) -> Array:
        return np.stack([_terms(q[:, j], dq[:, j], full) @ weights[j] for j in range(6)], axis=-1)

    return friction


def _residuals(bodies: Bodies) -> Callable[[Episode], tuple[Array, Array, Array]]:
    """Positions, speeds, and the torques that rigid bodies do not explain."""

    def of(episode: Episode) -> tuple[Array, Array, Array]:
        ddq = np.diff(episode["dq"], axis=0) / SAMPLE_TIME
        # an acceleration over a sample belongs to its middle
        q = (episode["q"][1:] + episode["q"][:-1]) / 2
        dq = (episode["dq"][1:] + episode["dq"][:-1]) / 2
        M, bias = bodies.at(q, dq)
        return q, dq, episode["tau"][:-1] - np.einsum("nij,nj->ni", M, ddq) - bias

    return of


def _terms(q: Array, dq: Array, full: bool) -> Array:
    sign = np.tanh(SHARPNESS * dq)
    if not full:
        return np.stack([dq, sign], axis=1)
    basis = np.stack([np.ones_like(q), np.sin(q), np.cos(q)], axis=1)
    return np.concatenate([dq[:, None] * basis, sign[:, None] * basis], axis=1)


def simulated(bodies: Bodies, friction: Friction, given: Windows) -> Array:
    """The positions along each rollout."""
    q, dq, h = given.q0, given.dq0, SAMPLE_TIME / SUBSTEPS
    found: list[Array] = []
    for tau in given.tau:
        for _ in range(SUBSTEPS):
            M, bias = bodies.at(q, dq)
            slope = (friction(q, dq + 1e-6) - friction(q, dq - 1e-6)) / 2e-6
            matrix = M + h * slope[:, :, None] * np.eye(6)
            right = h * (tau - friction(q, dq) - bias)
            dq = dq + np.linalg.solve(matrix, right[..., None])[..., 0]
            q = q + h * dq
        found.append(q)
    return np.array(found)


def errors(found: Array, given: Windows) -> Array:
    """The mean squared error of positions of each joint."""
    return np.mean((found - given.q) ** 2, axis=(0, 1))


def determination(found: Array, given: Windows) -> float:
    """R² of all positions: 1 is exact, 0 is what the mean position of each joint would give."""
    spread = given.q - given.q.mean(axis=(0, 1))
    return float(1 - np.sum((found - given.q) ** 2) / np.sum(spread**2))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    default = HERE / "runs" / "z1_friction" / "latest" / "weights.safetensors"
    parser.add_argument("--weights", type=Path, default=default)
    weights = parser.parse_args().weights
    bodies, train, test = Bodies(), episodes("train"), windows(episodes("test"))
    models: dict[str, Friction] = {
        "none": lambda q, dq: 0 * q,
        "least squares": regression(bodies, train, full=False),
        "full least squares": regression(bodies, train, full=True),
        "learned": learned(weights),
        "true": truth.friction,
    }
    kept: dict[str, list[float]] = {}
    print(f"{'mean squared error, rad²':36} {'all':>9}   each joint")
    for name, friction in models.items():
        each = errors(simulated(bodies, friction, test), test)
        kept[name] = each.tolist()
        title = results.FRICTIONS[name]
        print(f"{title:36} {np.mean(each):9.2e}   " + " ".join(f"{error:.1e}" for error in each))
    results.keep("errors", kept)
    count = sum(values.size for values in load_file(weights).values())
    print(f"the learned friction has {count} numbers")
    results.keep("numbers", count)


if __name__ == "__main__":
    main()

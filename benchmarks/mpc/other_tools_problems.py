"""Defines the two problems of `other_tools.py` for CasADi, in expressions written by hand.

The stage of the network is a separate function (`never_inline`): written out N times, its code is
nine times as long and takes twice the time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

N = 20
WINDOW = 30
Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Nlp:
    """A nonlinear program: its expressions, the bounds of variables, and the number of values per
    stage.
    """

    name: str
    expressions: dict[str, Any]
    low: Vector
    high: Vector
    stage: int
    rows: int

    @property
    def numbers(self) -> int:
        """The number of variables."""
        return len(self.low)


def network_step(weights: dict[str, Vector]) -> ca.Function:
    """The function x' = x + mlp(x, u), written by hand in scalars."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    inner = ca.vertcat(x, u)
    for layer in ("1", "2"):
        matrix, bias = weights[f"net.weight{layer}"], weights[f"net.bias{layer}"]
        inner = ca.tanh(ca.DM(matrix) @ inner + ca.DM(bias))
    after = x + ca.DM(weights["net.weight3"]) @ inner + ca.DM(weights["net.bias3"])
    return ca.Function("stage", [x, u], [after], {"never_inline": True})


def network_problem(step: ca.Function) -> Nlp:
    """The problem of the network; its variables are both states and the control of each sample."""
    states = [ca.MX.sym(f"x{k}", 2) for k in range(N + 1)]
    controls = [ca.MX.sym(f"u{k}") for k in range(N)]
    measured = ca.MX.sym("p", 2)
    variables: list[Any] = []
    gaps: list[Any] = []
    cost: Any = 0
    for k, x in enumerate(states):
        cost += (10 if k == N else 1) * (x[0] ** 2 + 0.01 * x[1] ** 2)
        variables.append(x)
        if k < N:
            cost += 0.02 * controls[k] ** 2
            variables.append(controls[k])
            gaps.append(states[k + 1] - step(x, controls[k]))
        if k == 0:
            gaps.append(x - measured)
    high = np.array([20.0, 20.0, 3.0] * N + [20.0, 20.0])
    expressions = {"x": ca.vertcat(*variables), "f": cost, "g": ca.vertcat(*gaps), "p": measured}
    return Nlp("mlp", expressions, -high, high, stage=3, rows=2)


def window_problem(weights: dict[str, Vector], *, is_called: bool) -> Nlp:
    """The problem of the filter without states: its variables are y and the control of each sample.

    The filters are either blended once per solve and written out, or blended in a called function.
    """
    kind: Any = ca.MX if is_called else ca.SX
    p = kind.sym("p", WINDOW + 1 + N + 1)
    places = [kind.sym(f"y{k}") for k in range(N + 1)]
    controls = [kind.sym(f"u{k}") for k in range(N)]
    speed, wanted = p[WINDOW], p[WINDOW + 1 :]
    slope, taps = _blended(weights, speed)
    stage = _called_stage(weights)
    variables: list[Any] = []
    gaps: list[Any] = []
    cost: Any = 0
    for k, y in enumerate(places):
        cost += (y - wanted[k]) ** 2
        variables.append(y)
        if k < N:
            cost += 1e-3 * controls[k] ** 2
            variables.append(controls[k])
            seen = ca.vertcat(p[1:WINDOW], *controls[: k + 1])[-WINDOW:]
            after = slope * y + 0.02 * ca.tanh(y) + ca.dot(taps, seen)
            gaps.append(places[k + 1] - (stage(y, speed, seen) if is_called else after))
        if k == 0:
            gaps.append(y - p[0])
    high = np.array([9.0, 3.0] * N + [9.0])
    expressions = {"x": ca.vertcat(*variables), "f": cost, "g": ca.vertcat(*gaps), "p": p}
    return Nlp("fir", expressions, -high, high, stage=2, rows=1)


def _blended(weights: dict[str, Vector], speed: Any) -> tuple[Any, Any]:
    inside: list[Any] = [ca.fmax(0, 1 - ca.fabs(speed - at) / 10) for at in (5, 15, 25)]
    inside[0] = ca.if_else(speed < 5, 1, inside[0])
    inside[2] = ca.if_else(speed > 25, 1, inside[2])
    slope: Any = sum(float(a) * m for a, m in zip(weights["a"], inside, strict=True))
    rows = weights["local.weight"]
    taps: Any = sum(ca.DM(row) * m for row, m in zip(rows, inside, strict=True))
    return slope, taps


def _called_stage(weights: dict[str, Vector]) -> ca.Function:
    y, speed, seen = ca.SX.sym("y"), ca.SX.sym("v"), ca.SX.sym("u", WINDOW)
    slope, taps = _blended(weights, speed)
    after = slope * y + 0.02 * ca.tanh(y) + ca.dot(taps, seen)
    return ca.Function("stage", [y, speed, seen], [after], {"never_inline": True})

"""Solves plants that the solver was not developed on, beside ipopt.

    python benchmarks/mpc/foreign.py [STARTS]

Each plant is a few lines of a spec: unstable, stiff, integrating, non-minimum phase, with kinks,
with many states. From each of several states both solve the same problem from
the plan of a control at rest; a
plan counts as solved where the interpreter finds its optimality conditions to twice the
tolerance. Where the costs differ by more than 1e-6, both are minima, or one is none.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import msnn
from msnn.features.control.run.interior_point.horizon_functions import HorizonFunctions
from msnn.tables import table_text

STARTS = 8
NEAR = 1e-6


@dataclass(frozen=True, slots=True)
class Plant:
    """A plant: its states with the formulas of their next values, and the range of initial
    states.
    """

    states: dict[str, str]
    stage: str
    terminal: str
    start: dict[str, tuple[float, float]]
    horizon: int = 20
    bounds: str = "u: {min: -1, max: 1}"
    sample: str = "0.1 s"
    kind: str = ""

    def spec(self, name: str) -> str:
        """The text of the plant's spec."""
        states = "\n".join(f'  {k}: {{next: "{v}", init: 0}}' for k, v in self.states.items())
        first = next(iter(self.states))
        return (
            f"msnn: 1\nname: {name}\nsample_time: {self.sample}\n"
            f"inputs: {{u: {{between: hold}}}}\nstates:\n{states}\n"
            f"outputs: {{seen: 1 * {first}}}\n"
            f"mpc:\n  horizon: {self.horizon}\n  controls: [u]\n"
            f'  cost: {{stage: "{self.stage}", terminal: "{self.terminal}"}}\n'
            f"  bounds: {{{self.bounds}}}\n"
        )


def _around(*names: str, far: float = 1.0) -> dict[str, tuple[float, float]]:
    return dict.fromkeys(names, (-far, far))


PLANTS = {
    "pendulum_up": Plant(
        {"q": "q + 0.1 * w", "w": "w + 0.1 * (5 * sin(q) - 0.2 * w + 3 * u)"},
        "q**2 + 0.1 * w**2 + 0.05 * u**2", "10 * q**2 + w**2", _around("q", "w", far=0.4),
        bounds="u: {min: -2, max: 2}", kind="unstable",
    ),
    "swing_up": Plant(
        {"q": "q + 0.1 * w", "w": "w + 0.1 * (5 * sin(q) - 0.1 * w + u)"},
        "1 - cos(q) + 0.02 * w**2 + 0.02 * u**2", "20 * (1 - cos(q)) + w**2",
        {"q": (2.5, 3.7), "w": (-0.5, 0.5)}, horizon=40, bounds="u: {min: -3, max: 3}",
        kind="unstable, several minima",
    ),
    "unstable_linear": Plant(
        {"x": "1.2 * x + 0.5 * u"}, "x**2 + 0.1 * u**2", "x**2", _around("x", far=1.5),
        kind="unstable",
    ),
    "unstable_cubic": Plant(
        {"x": "x + 0.1 * (x + 0.3 * x**3 + 2 * u)"}, "x**2 + 0.05 * u**2", "5 * x**2",
        _around("x", far=1.2), kind="unstable",
    ),
    "ball_and_beam": Plant(
        {"r": "r + 0.1 * v", "v": "v + 0.1 * (r * w**2 - 7 * sin(q))", "q": "q + 0.1 * w",
         "w": "w + 0.1 * 4 * u"},
        "r**2 + 0.1 * v**2 + 0.1 * q**2 + 0.02 * u**2", "5 * r**2 + v**2 + q**2 + w**2",
        {"r": (-0.5, 0.5), "q": (-0.2, 0.2)}, horizon=30,
        bounds="u: {min: -3, max: 3}, q: {min: -0.4, max: 0.4}", kind="chain, unstable",
    ),
    "cart_pole": Plant(
        {"p": "p + 0.05 * v", "v": "v + 0.05 * (u + 0.1 * sin(q) * w**2)", "q": "q + 0.05 * w",
         "w": "w + 0.05 * (9.8 * sin(q) - u * cos(q))"},
        "p**2 + 5 * q**2 + 0.1 * v**2 + 0.1 * w**2 + 0.01 * u**2",
        "10 * p**2 + 50 * q**2 + v**2 + w**2", {"p": (-1, 1), "q": (-0.3, 0.3)}, horizon=30,
        bounds="u: {min: -8, max: 8}, p: {min: -1.2, max: 1.2}", sample="0.05 s",
        kind="unstable, non-minimum phase",
    ),
    "stiff_heat": Plant(
        {"a": "0.02 * a + 0.98 * u", "b": "b + 0.3 * (a - b)", "c": "c + 0.02 * (b - c)"},
        "(c - 0.3)**2 + 0.01 * u**2", "10 * (c - 0.3)**2", _around("a", "b", "c", far=0.5),
        horizon=30, kind="stiff",
    ),
    "stiff_reaction": Plant(
        {"x": "(x + 0.1 * u) / (1 + 5 * abs(x))", "y": "y + 0.05 * (x - y**3)"},
        "(y - 0.3)**2 + 0.01 * u**2", "(y - 0.3)**2", {"x": (0.05, 1), "y": (0, 1)},
        kind="stiff",
    ),
    "van_der_pol": Plant(
        {"x": "x + 0.1 * y", "y": "y + 0.1 * (2 * (1 - x**2) * y - x + u)"},
        "x**2 + y**2 + 0.1 * u**2", "5 * x**2 + 5 * y**2", _around("x", "y", far=2.0),
        kind="stiff, limit cycle",
    ),
    "double_integrator": Plant(
        {"p": "p + 0.1 * v + 0.005 * u", "v": "v + 0.1 * u"},
        "p**2 + 0.1 * v**2 + 0.01 * u**2", "10 * p**2 + v**2", _around("p", "v", far=2.0),
        bounds="u: {min: -1, max: 1}, v: {min: -0.8, max: 0.8}", horizon=30, kind="integrators",
    ),
    "triple_integrator": Plant(
        {"p": "p + 0.1 * v", "v": "v + 0.1 * a", "a": "a + 0.1 * u"},
        "p**2 + 0.1 * v**2 + 0.01 * u**2", "10 * p**2 + 5 * v**2 + a**2",
        _around("p", "v", "a", far=0.7), bounds="u: {min: -3, max: 3}, a: {min: -1, max: 1}",
        horizon=40, kind="integrators",
    ),
    "integrator_with_rate": Plant(
        {"x": "x + 0.2 * u"}, "(x - 1)**2 + 0.001 * u**2", "(x - 1)**2", _around("x", far=3.0),
        bounds="u: {min: -1, max: 1, rate: 1 1/s}", kind="integrator, rate",
    ),
    "inverse_response": Plant(
        {"a": "0.8 * a + 0.3 * u", "b": "0.9 * b + 0.2 * a - 0.25 * u"},
        "(b - 0.4)**2 + 0.02 * u**2", "5 * (b - 0.4)**2", _around("a", "b"),
        kind="non-minimum phase",
    ),
    "delayed": Plant(
        {"x": "0.95 * x + 0.1 * u[t-5]"}, "(x - 0.5)**2 + 0.01 * u**2", "5 * (x - 0.5)**2",
        _around("x"), kind="non-minimum phase (delay)",
    ),
    "dead_zone": Plant(
        {"x": "0.95 * x + 0.3 * (max(u - 0.2, 0) + min(u + 0.2, 0))"},
        "x**2 + 0.01 * u**2", "5 * x**2", _around("x", far=2.0), kind="kinks",
    ),
    "dry_friction": Plant(
        {"p": "p + 0.1 * v", "v": "v + 0.1 * (2 * u - 0.4 * tanh(20 * v))"},
        "p**2 + 0.05 * v**2 + 0.02 * u**2", "5 * p**2 + v**2", _around("p", "v"), kind="kinks",
    ),
    "hard_stop": Plant(
        {"p": "p + 0.1 * v", "v": "v + 0.1 * (2 * u - 20 * max(p - 0.5, 0) - 0.3 * v)"},
        "(p - 0.6)**2 + 0.02 * u**2", "5 * (p - 0.6)**2", _around("p", "v", far=0.4),
        kind="kinks",
    ),
    "absolute_cost": Plant(
        {"x": "0.9 * x + 0.3 * u"}, "sqrt(x**2 + 1e-4) + 0.01 * u**2", "5 * x**2",
        _around("x", far=2.0), kind="nearly a kink",
    ),
    "tank_with_root": Plant(
        {"h": "h + 0.1 * (0.5 * u - 0.6 * sqrt(max(h, 1e-3)))"},
        "(h - 0.6)**2 + 0.01 * u**2", "5 * (h - 0.6)**2", {"h": (0.01, 1.5)},
        bounds="u: {min: 0, max: 2}, h: {max: 1}", kind="kinks",
    ),
    "draining_tank": Plant(
        {"h": "h + 0.1 * (0.5 * u - 0.6 * sqrt(h))"},
        "(h - 0.6)**2 + 0.01 * u**2", "5 * (h - 0.6)**2", {"h": (0.01, 1.5)},
        bounds="u: {min: 0, max: 2}, h: {max: 1}", kind="no values below 0",
    ),
    "bilinear_reactor": Plant(
        {"c": "c + 0.1 * (1 - c - 2 * c * h * h)",
         "h": "h + 0.1 * (0.5 - h + 1.5 * c * h * h + u * (0.2 - h))"},
        "(h - 0.7)**2 + 0.1 * (c - 0.5)**2 + 0.01 * u**2", "5 * (h - 0.7)**2",
        {"c": (0.2, 1), "h": (0.2, 1.2)}, bounds="u: {min: 0, max: 2}", horizon=25,
        kind="non-convex",
    ),
    "saturating_actuator": Plant(
        {"x": "1.05 * x + 0.3 * tanh(3 * u)"}, "x**2 + 0.01 * u**2", "5 * x**2",
        _around("x", far=2.5), bounds="u: {min: -2, max: 2}", kind="unstable, non-convex",
    ),
    "chain_of_masses": Plant(
        {**{f"p{i}": f"p{i} + 0.2 * v{i}" for i in range(4)},
         **{f"v{i}": f"v{i} + 0.2 * (" + (f"p{i - 1}" if i else "0") + f" - 2 * p{i} + "
            + (f"p{i + 1}" if i < 3 else "u") + f" - 0.1 * v{i})" for i in range(4)}},
        "p0**2 + p3**2 + 0.05 * u**2", "5 * p0**2 + p3**2 + v0**2", _around("p0", "p3", far=2.0),
        horizon=30, kind="many states",
    ),
}  # fmt: skip


def solve_plant(name: str, plant: Plant, starts: int, folder: Path) -> tuple[str, ...]:
    """Solves from several states by both solvers; returns the row of the table."""
    path = folder / f"{name}.msnn.yaml"
    path.write_text(plant.spec(name), encoding="utf-8")
    controller = msnn.mpc(msnn.load(path), solver="c")
    nlp = controller.casadi("ipopt")
    functions = HorizonFunctions(controller.problem)
    random = np.random.default_rng(11)
    counts = dict.fromkeys(("solved", "capped", "equal", "better", "worse", "ipopt fails"), 0)
    iterations: list[int] = []
    widest = 0.0
    for _ in range(starts):
        controller.reset()
        x = dict.fromkeys(plant.states, 0.0)
        x |= {key: float(random.uniform(*ends)) for key, ends in plant.start.items()}
        found = controller.solve(x)
        iterations.append(found.iterations)
        if found.given is None or found.plan is None:
            continue
        is_solved = found.status == 0 and controller.residuals(found).largest <= 2e-6
        counts["solved" if is_solved else "capped"] += 1
        resting = np.tile(functions.resting, (plant.horizon, 1)) / functions.scale_u
        states = functions.rollout(found.given, resting)
        if not np.isfinite(states).all():
            states[:] = states[0]
        other = nlp.solve(found.given, functions.plan(states, resting))
        if not other.succeeded:
            counts["ipopt fails"] += 1
            continue
        difference = (found.cost - other.cost) / max(1.0, abs(other.cost))
        widest = max(widest, abs(difference))
        kind = "equal" if abs(difference) <= NEAR else "better" if difference < 0 else "worse"
        counts[kind] += 1
    return (
        name, plant.kind, f"{counts['solved']}/{starts}",
        f"{np.median(iterations):.0f}/{max(iterations)}",
        *(str(counts[key]) for key in ("equal", "better", "worse", "ipopt fails")),
        f"{widest:.0e}",
    )  # fmt: skip


def main() -> None:
    """Prints the table."""
    starts = int(sys.argv[1]) if len(sys.argv) > 1 else STARTS
    with tempfile.TemporaryDirectory() as place:
        rows = [solve_plant(n, plant, starts, Path(place)) for n, plant in PLANTS.items()]
    header = ("plant", "what it is", "solved", "iterations", "equal", "better", "worse")
    print(table_text((*header, "ipopt fails", "widest"), rows, numbers=list(range(2, 9))))
    print("solved: by the interpreter; iterations: median/most; equal: within 1e-6 of ipopt's cost")


if __name__ == "__main__":
    main()

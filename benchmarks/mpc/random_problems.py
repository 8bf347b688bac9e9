"""Solves random problems by exported controllers, and judges whatever is called solved.

    python benchmarks/mpc/random_problems.py [PROBLEMS] [SEED] [STRUCTURE] [blocks]

Plants are drawn (states, controls, horizon, what bends, what is bounded), each is exported,
compiled and given 100 problems: states far out, weights of 0, limits that are equal or contradict
each other, hard bounds that cannot hold, NaN and infinite numbers, from a plan and without. Three
promises are looked at in each:

- what is called solved is optimal to twice the tolerance and the rounding of the largest
  multiplier of a control, by the interpreter, which knows nothing of the solver; NaN is not;
- controls are finite and inside their limits wherever these leave room, whatever the status;
- no byte outside of the structs is written: 64 before and behind each.

With `blocks` controls stay the same over blocks of samples, whose limits differ from sample to
sample.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import msnn
from backends.c.host.build import build_library
from backends.predictive_control.inputs import input_fields
from backends.predictive_control.library import ControllerLibrary
from backends.predictive_control.solution import multipliers_of, plan_of
from backends.predictive_control.structure.rows import rows_of
from backends.predictive_control.write_controller import controller_texts
from compiler.optimal_control.horizon import Given
from compiler.optimal_control.kkt import Judge
from compiler.optimal_control.problem import ControlProblem
from compiler.optimal_control.structure import Chosen
from compiler.optimal_control.trained import trained

EACH = 100
GUARD, PATTERN = 64, 0xA5
STATUSES = ("solved", "capped", "infeasible", "input not finite", "not initialised")
WEIGHTS = ("q", "w", "e")
WIDTHS = (0.0, 1e-12, 0.5, 2.0, 20.0, -1.0)
NO_ROOM = 1e-9
"""Limits nearer to each other than this, by the scale, hold a control (`LEAST_ROOM`)."""
OFTEN = (0.1, 0.05, 0.3, 0.4, 0.1, 0.05)


def spec(random: np.random.Generator, has_blocks: bool) -> str:
    """A plant with a controller; weights and limits are references, so that each problem has its
    own."""
    nx, nu = int(random.integers(1, 4)), int(random.integers(1, 3))
    bends = ("0.3 * sin({})", "0.2 * {}**2", "0.5 * tanh({})", "0.1 * abs({})", "0")
    states: list[str] = []
    for i in range(nx):
        terms = [f"{random.uniform(-0.5, 0.6):.3f} * x{j}" for j in range(nx)]
        terms.append(f"{random.uniform(0.6, 1.1):.3f} * x{i}")
        terms += [f"{random.normal():.3f} * u{j}" for j in range(nu)]
        terms.append(str(random.choice(bends)).format(f"x{random.integers(nx)}"))
        states.append(f'  x{i}: {{next: "{" + ".join(terms)}", init: 0}}')
    bounds = [f"    u{j}: {{min: lo{j}, max: hi{j}}}" for j in range(nu)]
    kind = random.integers(4)
    if kind:
        extra = ", hard: true" if kind == 1 else ""
        bounds.append(f"    x0: {{max: top{extra}}}")
    if kind == 3 and nx > 1:
        bounds.append("    x1: {min: -top}")
    moves = " + ".join(f"u{j}**2" for j in range(nu))
    far = " + ".join(f"x{i}**2" for i in range(1, nx)) or "0"
    stage = f"q * ((x0 - r)**2 + {far}) + w * ({moves})"
    curve = random.choice(["exact", "gauss_newton"])
    names = [*WEIGHTS, "r", "top", *(f"{end}{j}" for j in range(nu) for end in ("lo", "hi"))]
    horizon = int(random.choice([1, 2, 5, 10, 20]))
    held: list[str] = []
    previewed: tuple[str, ...] = ()
    if has_blocks:
        blocks: list[int] = []
        while sum(blocks) < horizon:
            blocks.append(int(random.integers(1, 1 + min(7, horizon - sum(blocks)))))
        held = [f"  blocks: {blocks}"]
        previewed = tuple(name for name in names if name.startswith(("lo", "hi")))
    references = (f"{n}: {{{'preview: true' if n in previewed else ''}}}" for n in names)
    return "\n".join(
        (
            "msnn: 1\nname: drawn\nsample_time: 1 s",
            f"inputs: {{{', '.join(f'u{j}: {{between: hold}}' for j in range(nu))}}}",
            "states:",
            *states,
            "outputs: {y: 1 * x0}",
            "mpc:",
            f"  horizon: {horizon}",
            f"  controls: [{', '.join(f'u{j}' for j in range(nu))}]",
            f"  hessian: {curve}",
            f"  references: {{{', '.join(references)}}}",
            *held,
            f'  cost: {{stage: "{stage}", terminal: "e * (x0 - r)**2"}}',
            "  bounds:",
            *bounds,
        )
    )


def problem_values(
    names: list[str], nx: int, random: np.random.Generator
) -> tuple[NDArray[Any], dict[str, float]]:
    """A state, and references by name."""
    x = random.normal(size=nx) * random.choice([0.1, 1.0, 3.0, 30.0])
    known = {name: float(random.normal()) for name in names}
    for name in WEIGHTS:
        known[name] = 0.0 if random.uniform() < 0.25 else 10.0 ** random.uniform(-3, 2)
    if "top" in known:
        known["top"] = float(random.choice([-0.5, 0.2, 1.0, 5.0]))
    for name in names:
        if name.startswith("lo"):
            width = random.choice(
                [0.0, 1e-12, 0.5, 2.0, 20.0, -1.0], p=[0.1, 0.05, 0.3, 0.4, 0.1, 0.05]
            )
            middle = float(random.normal())
            known[name], known["hi" + name[2:]] = middle - width / 2, middle + width / 2
    if random.uniform() < 0.05:
        x[random.integers(nx)] = random.choice([np.nan, np.inf, -np.inf, 1e300])
    if random.uniform() < 0.05:
        known[str(random.choice(names))] = float(random.choice([np.nan, np.inf, 1e300, 1e-310]))
    return x, known


class Guarded:
    """Memory of a struct with bytes around it that nobody may write."""

    def __init__(self, struct: NDArray[Any]) -> None:
        self._bytes = np.full(2 * GUARD + struct.nbytes, PATTERN, np.uint8)
        self.struct = self._bytes[GUARD:-GUARD].view(struct.dtype)
        self.struct[:] = struct

    @property
    def is_whole(self) -> bool:
        outside = np.concatenate([self._bytes[:GUARD], self._bytes[-GUARD:]])
        return bool(np.all(outside == PATTERN))


def solve_plant(
    text: str, count: int, random: np.random.Generator, folder: Path, structure: Chosen | None
) -> Counter[str]:
    """Draws and solves problems of one plant; what was found, by words."""
    path = folder / "drawn.msnn.yaml"
    path.write_text(text, encoding="utf-8")
    control = msnn.load(path).control
    assert control is not None
    control = control if structure is None else replace(control, structure=structure)
    problem = trained(control, {})
    for name, written in controller_texts(problem, "drawn", "float64").items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(written, encoding="utf-8")
    library = ControllerLibrary.of_folder(folder, build_library(folder, folder / "drawn.so"))
    guards = [Guarded(getattr(library, name)) for name in ("_state", "_in", "_out")]
    for name, guard in zip(("_state", "_in", "_out"), guards, strict=True):
        setattr(library, name, guard.struct)
    judge, rows = Judge(problem), rows_of(problem)
    names = [member.name for member in problem.references.members]
    fields = {field.name: field.identifier for field in input_fields(problem)}
    found: Counter[str] = Counter()
    for _ in range(count):
        x, known = problem_values(names, problem.states.size, random)
        if random.uniform() < 0.6:
            library.init()
        along = {n: np.full(problem.horizon + 1, value) for n, value in known.items()}
        # limits of a block are equal in half of the problems, as those of a motor are
        moves = 0.2 * random.integers(2) if problem.previewed else 0.0
        for name in sorted(problem.previewed):
            along[name] += moves * random.uniform(-1, 1, problem.horizon + 1)
        samples = {n: v if n in problem.previewed else v[:1] for n, v in along.items()}
        decision = library.solve({"x": x, **{fields[n]: v for n, v in samples.items()}})
        found[STATUSES[decision.status]] += 1
        every = _limits(problem, along)
        limits = [(each[0][0], each[1][0]) for each in every]
        held = [sides for each in every for sides in _by_block(problem, *each)]
        if not np.all(np.isfinite(decision.control)):
            found["WRONG: a control that is not finite"] += 1
        if decision.status < 3:
            for u, (low, high) in zip(decision.control, limits, strict=True):
                if low <= high and not low <= u <= high:
                    found["WRONG: a control outside its limits"] += 1
        if not all(guard.is_whole for guard in guards):
            found["WRONG: a write outside of the structs"] += 1
        is_finite = all(bool(np.all(np.isfinite(each))) for each in (x, *along.values()))
        if is_finite == (decision.status == 3):
            found["WRONG: what is not finite and status 3"] += 1
        if decision.status < 2 and any(low > high for low, high in held):
            found["WRONG: contradicting limits are not infeasible"] += 1
        if decision.status == 0:
            plan, multipliers = plan_of(problem, library), multipliers_of(problem, rows, library)
            with np.errstate(all="ignore"):
                residual = judge.residuals(Given(x, {}, along), plan, multipliers).largest
            # multipliers of controls without room take slopes of any size, as exact as they are;
            # the other limit is as far as there is room
            sides = (multipliers.control_min, multipliers.control_max)
            room = max((high - low for low, high in held if high - low < NO_ROOM), default=0.0)
            exact = 1e3 * np.finfo(float).eps + 2 * room
            rounding = exact * max(float(np.max(side)) for side in sides)
            if not residual <= 2 * problem.tolerance + rounding:
                found["WRONG: called solved"] += 1
                told = {name: values.tolist() for name, values in along.items()}
                print(f"residual {residual} of\n{text}\nx = {x.tolist()}, {told}")
    return found


def _limits(
    problem: ControlProblem, along: dict[str, NDArray[Any]]
) -> list[tuple[NDArray[Any], NDArray[Any]]]:
    """The lowest and highest value of each control along the horizon."""
    numbers = range(problem.controls.size)
    return [(along[f"lo{j}"][:-1], along[f"hi{j}"][:-1]) for j in numbers]


def _by_block(
    problem: ControlProblem, low: NDArray[Any], high: NDArray[Any]
) -> list[tuple[float, float]]:
    """What is left for the one control of each block."""
    begins = np.cumsum((0, *problem.blocks[:-1]))
    ends = np.maximum.reduceat(low, begins), np.minimum.reduceat(high, begins)
    return list(zip(*(end.tolist() for end in ends), strict=True))


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
    random = np.random.default_rng(int(sys.argv[2]) if len(sys.argv) > 2 else 0)
    words = sys.argv[3:]
    structure: Chosen | None = "staged" if "staged" in words else None
    structure = "condensed" if "condensed" in words else structure
    has_blocks = "blocks" in words
    found: Counter[str] = Counter()
    begun = time.perf_counter()
    for number in range(0, count, EACH):
        with tempfile.TemporaryDirectory() as place:
            each = min(EACH, count - number)
            text = spec(random, has_blocks)
            found += solve_plant(text, each, random, Path(place), structure)
        done = min(number + EACH, count)
        said = ", ".join(f"{n:,} {what}" for what, n in sorted(found.items()))
        print(f"{done:,} problems, {time.perf_counter() - begun:.0f} s: {said}", flush=True)


if __name__ == "__main__":
    main()

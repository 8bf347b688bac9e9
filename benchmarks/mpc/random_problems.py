"""Solves random problems by exported controllers, and judges whatever is called solved.

    python benchmarks/mpc/random_problems.py [PROBLEMS] [SEED] [STRUCTURE] [blocks] [--write]

Plants are drawn by `random_plants.py` (states, controls, horizon, what bends, what is bounded, what
is remembered), each is exported, compiled and given 100 problems: states far out, weights of 0,
limits that are equal or contradict each other, hard bounds that cannot hold, NaN and infinite
numbers, from a plan and without. Three
promises are looked at in each:

- what is called solved is optimal to twice the tolerance and the rounding of the largest
  multiplier of a control, by the interpreter, which knows nothing of the solver; NaN is not;
- controls are finite and inside their limits wherever these leave room, whatever the status, and
  where there is a plan they moved no faster than their rates;
- no byte outside of the structs is written: 64 before and behind each.

With `blocks` controls stay the same over blocks of samples, whose limits differ from sample to
sample. `--write` puts the counts in `random_problems.json`.
"""

from __future__ import annotations

import json
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
from msnn.features.control.backend.inputs import input_fields
from msnn.features.control.backend.library import ControllerLibrary, multipliers_of, plan_of
from msnn.features.control.backend.structure.rows import Rows, rows_of
from msnn.features.control.backend.write_controller import controller_texts
from msnn.features.control.problem.horizon import Given
from msnn.features.control.problem.kkt import Judge
from msnn.features.control.problem.optimal_control import ControlProblem
from msnn.features.control.problem.structure import Chosen
from msnn.features.control.problem.trained import trained

sys.path.insert(0, str(Path(__file__).parent))
from random_plants import WEIGHTS, Plant, computed_limits, drawn_plant

RESULTS = Path(__file__).parent / "random_problems.json"
EACH = 100
GUARD, PATTERN = 64, 0xA5
STATUSES = ("solved", "capped", "infeasible", "input not finite", "not initialised")
WIDTHS = (0.0, 1e-12, 0.5, 2.0, 20.0, -1.0)
NO_ROOM = 1e-9
"""Limits nearer to each other than this, by the scale, hold a control (`LEAST_ROOM`)."""
OFTEN = (0.1, 0.05, 0.3, 0.4, 0.1, 0.05)


def problem_values(
    names: tuple[str, ...], nx: int, random: np.random.Generator
) -> tuple[NDArray[Any], dict[str, float]]:
    """A random state, and values of the references by name."""
    x = random.normal(size=nx) * random.choice([0.1, 1.0, 3.0, 30.0])
    known = {name: float(random.normal()) for name in names}
    for name in WEIGHTS:
        known[name] = 0.0 if random.uniform() < 0.25 else 10.0 ** random.uniform(-3, 2)
    if "s" in known:
        known["s"] = -0.5 if random.uniform() < 0.05 else float(random.normal()) ** 2
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
        known[str(random.choice(list(names)))] = float(
            random.choice([np.nan, np.inf, 1e300, 1e-310])
        )
    return x, known


class Guarded:
    """The memory of a C struct with guard bytes around it, to find writes outside of the struct."""

    def __init__(self, struct: NDArray[Any]) -> None:
        self._bytes = np.full(2 * GUARD + struct.nbytes, PATTERN, np.uint8)
        self.struct = self._bytes[GUARD:-GUARD].view(struct.dtype)
        self.struct[:] = struct

    @property
    def is_whole(self) -> bool:
        outside = np.concatenate([self._bytes[:GUARD], self._bytes[-GUARD:]])
        return bool(np.all(outside == PATTERN))


def solve_plant(
    plant: Plant, count: int, random: np.random.Generator, folder: Path, structure: Chosen | None
) -> Counter[str]:
    """Draws and solves `count` problems of one plant; returns the number of each kind of result."""
    path = folder / "drawn.msnn.yaml"
    path.write_text(plant.text, encoding="utf-8")
    control = msnn.load(path).of(ControlProblem)
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
    # a spec that reads no `top` has none
    known_of = {member.name for member in problem.references.members}
    names = tuple(
        n for n in plant.known if n in known_of or (plant.is_vector and n[:2] in known_of)
    )
    fields = {field.name: field.identifier for field in input_fields(problem)}
    found: Counter[str] = Counter()
    for _ in range(count):
        x, known = problem_values(names, problem.states.size, random)
        if random.uniform() < 0.6:
            library.init()
        along = {n: np.full(problem.horizon + 1, value) for n, value in known.items()}
        # limits of a block are equal in half of the problems, as those of a motor are
        moves = 0.2 * random.integers(2) if problem.previewed else 0.0
        for name in (n for n in plant.known if problem.previewed and n[:2] in ("lo", "hi")):
            along[name] += moves * random.uniform(-1, 1, problem.horizon + 1)
        if "s" in along and "s" in problem.previewed:
            along["s"] += moves * random.uniform(-0.1, 2, problem.horizon + 1)
        every = _limits(plant, problem, along)
        along = _joined(plant, along)
        samples = {n: v if n in problem.previewed else v[:1] for n, v in along.items()}
        decision = library.solve({"x": x, **{fields[n]: v for n, v in samples.items()}})
        found[STATUSES[decision.status]] += 1
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
        is_finite &= not any(bool(np.any(np.isnan(side))) for each in every for side in each)
        if is_finite == (decision.status == 3):
            found["WRONG: what is not finite and status 3"] += 1
        if decision.status < 2 and any(low > high for low, high in held):
            found["WRONG: contradicting limits are not infeasible"] += 1
        if decision.status < 2:
            found += _of_rates(rows, x, decision.control, limits)
        if decision.status == 0:
            plan, multipliers = plan_of(problem, library), multipliers_of(problem, rows, library)
            with np.errstate(all="ignore"):
                residual = judge.residuals(Given(x, {}, along), plan, multipliers).largest
            # multipliers of controls without room take slopes of any size, as exact as they are;
            # the other limit is as far as there is room
            sides = (multipliers.control_min, multipliers.control_max)
            room = max((high - low for low, high in held if high - low < NO_ROOM), default=0.0)
            exact = 1e3 * np.finfo(float).eps + 2 * room
            largest = max(float(np.max(side)) for side in sides)
            rounding = exact * problem.cost_scale * largest
            if not residual <= 2 * problem.tolerance + rounding:
                found["WRONG: called solved"] += 1
                told = {name: values.tolist() for name, values in along.items()}
                print(f"residual {residual} of\n{plant.text}\nx = {x.tolist()}, {told}")
    return found


def _limits(
    plant: Plant, problem: ControlProblem, along: dict[str, NDArray[Any]]
) -> list[tuple[NDArray[Any], NDArray[Any]]]:
    """The lower and upper limit of each control at each sample of the horizon."""
    found: list[tuple[NDArray[Any], NDArray[Any]]] = []
    for j in range(problem.controls.size):
        sides = along[f"lo{j}"], along[f"hi{j}"]
        if plant.is_computed:
            with np.errstate(invalid="ignore"):
                sides = computed_limits(*sides, along["r"], along["s"])
        found.append((sides[0][:-1], sides[1][:-1]))
    return found


def _of_rates(
    rows: Rows, x: NDArray[Any], control: NDArray[Any], limits: list[tuple[float, float]]
) -> Counter[str]:
    """Violations of rate limits by a control that belongs to a plan."""
    found: Counter[str] = Counter()
    for rate in rows.rates:
        before, (low, high) = x[rate.before], limits[rate.control]
        if before + rate.most < low or before - rate.most > high:
            found["WRONG: limits out of reach are not infeasible"] += 1
        rounding = 4 * np.finfo(float).eps * (abs(before) + rate.most)
        if not abs(control[rate.control] - before) <= rate.most + rounding:
            found["WRONG: a control moved faster than its rate"] += 1
    return found


def _joined(plant: Plant, along: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """The references in the form of the spec: limits of a vector control are vectors."""
    if not plant.is_vector:
        return along
    others = {name: values for name, values in along.items() if name[:2] not in ("lo", "hi")}
    ends = {end: np.stack([along[f"{end}{j}"] for j in range(2)], axis=-1) for end in ("lo", "hi")}
    return others | ends


def _by_block(
    problem: ControlProblem, low: NDArray[Any], high: NDArray[Any]
) -> list[tuple[float, float]]:
    """The limits of the single control of each block: the tightest of its samples."""
    begins = np.cumsum((0, *problem.blocks[:-1]))
    ends = np.maximum.reduceat(low, begins), np.minimum.reduceat(high, begins)
    return list(zip(*(end.tolist() for end in ends), strict=True))


def main() -> None:
    numbers = [int(each) for each in sys.argv[1:] if each.isdecimal()]
    count, seed = [*numbers, *(10_000, 0)[len(numbers) :]]
    random = np.random.default_rng(seed)
    words = sys.argv[1:]
    structure: Chosen | None = "staged" if "staged" in words else None
    structure = "condensed" if "condensed" in words else structure
    has_blocks = "blocks" in words
    found: Counter[str] = Counter()
    begun = time.perf_counter()
    for number in range(0, count, EACH):
        with tempfile.TemporaryDirectory() as place:
            each = min(EACH, count - number)
            plant = drawn_plant(random, has_blocks)
            found += solve_plant(plant, each, random, Path(place), structure)
        done = min(number + EACH, count)
        said = ", ".join(f"{n:,} {what}" for what, n in sorted(found.items()))
        print(f"{done:,} problems, {time.perf_counter() - begun:.0f} s: {said}", flush=True)

    if "--write" in words:
        kind = " ".join([structure or "auto", *(["blocks"] if has_blocks else [])])
        _write(f"{kind}, seed {seed}", {"problems": count, **dict(sorted(found.items()))})


def _write(run: str, counts: dict[str, int]) -> None:
    """Adds a run to the results."""
    runs: dict[str, Any] = (
        json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.exists() else {}
    )
    told = json.dumps(runs | {run: counts}, indent=2, sort_keys=True)
    RESULTS.write_text(told + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()

"""Solves random problems in other units of states, controls and cost, and compares with the first.

    python benchmarks/mpc/other_units.py [PROBLEMS] [SEED] [--write]

Plants are drawn by `random_plants.py`; states and controls have ranges. Each plant is written again
with D x for x, E u for u and c J for J, and solved for the same starts and references:

- D, E and c powers of two up to 2^±20: status, iterations, residual and controls are the same to
  the bit, in C (double and single precision, solve and prepare + feedback) and in Python; where
  there is no plan, status and controls;
- D, E and c up to 1e±6: the status is the same; the share is counted.

In single precision, whose numbers end at 1e±38, exponents are a third of these.

Half of the plants are solved stage by stage and half condensed, a quarter holds controls over
blocks. Of ten problems of a plant the first begins without a plan, the others at the plan before.
`--write` puts the counts in `RESULTS.md`.
"""

from __future__ import annotations

import re
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import msnn
from backends.c.host.build import build_library
from backends.c_language.literals import Dtype
from benchmarks.mpc.random_plants import WEIGHTS, Plant, drawn_plant
from msnn.features.control.backend.inputs import input_fields
from msnn.features.control.backend.library import ControllerLibrary
from msnn.features.control.backend.write_controller import controller_texts
from msnn.features.control.problem.horizon import Given
from msnn.features.control.problem.optimal_control import ControlProblem
from msnn.features.control.problem.structure import Chosen, signals_held
from msnn.features.control.problem.trained import trained
from msnn.features.control.run.control_range import ControlRange
from msnn.features.control.run.interior_point.horizon_functions import HorizonFunctions
from msnn.features.control.run.method import Status
from msnn.features.control.run.reference_method import ReferenceMethod
from msnn.model.weights.weights_file import initial_weights

Array = NDArray[np.float64]
RESULTS = Path(__file__).parent / "RESULTS.md"
EACH = 10
STATES, CONTROLS = 3, 2
_RANGE = 3.0


@dataclass(frozen=True, slots=True)
class Units:
    """The factors by which states, controls and cost of a plant are multiplied."""

    states: tuple[float, ...]
    controls: tuple[float, ...]
    cost: float

    @classmethod
    def drawn(cls, random: np.random.Generator, base: float, most: int, *, whole: bool) -> Units:
        """Random factors: `base` to exponents up to `most`, integers if `whole`."""
        exponents = random.uniform(-most, most, STATES + CONTROLS + 1)
        factors = [float(base**e) for e in (np.round(exponents) if whole else exponents)]
        return cls(tuple(factors[:STATES]), tuple(factors[STATES:-1]), factors[-1])

    def nearer(self) -> Units:
        """A third of the exponents, for single precision, whose squares end at 1e±19."""
        exponents = np.log2([*self.states, *self.controls, self.cost]) / 3
        whole = bool(np.all(np.log2(self.states) % 1 == 0))
        factors = [float(2.0**e) for e in (np.round(exponents) if whole else exponents)]
        return Units(tuple(factors[:STATES]), tuple(factors[STATES:-1]), factors[-1])


SAME = Units((1.0,) * STATES, (1.0,) * CONTROLS, 1.0)


def in_units(plant: Plant, units: Units) -> str:
    """The spec of a plant, with ranges, whose states, controls and cost have other units."""
    lines: list[str] = []
    for line in plant.text.splitlines():
        if state := re.fullmatch(r'  x(\d): \{next: "(.*)", init: 0\}', line):
            factor, end = units.states[int(state[1])], _RANGE * units.states[int(state[1])]
            line = (
                f'  x{state[1]}: {{next: "({_read(state[2], units)}) * {factor!r}", init: 0, '
                f"range: [{-end!r}, {end!r}]}}"
            )
        elif line.startswith("inputs:"):
            line = re.sub(
                r"(u(\d?)): \{between: hold",
                lambda found: f"{found[1]}: {{between: hold, range: {_ends(units, found[2])}",
                line,
            )
        elif cost := re.fullmatch(r'  cost: \{stage: "(.*)", terminal: "(.*)"\}', line):
            stage, terminal = (f"{units.cost!r} * ({_read(each, units)})" for each in cost.groups())
            line = f'  cost: {{stage: "{stage}", terminal: "{terminal}"}}'
        elif bound := re.fullmatch(r"    (x|u)(\d?): \{(.*)\}", line):
            of_kind = units.states if bound[1] == "x" else units.controls
            factor = of_kind[int(bound[2] or 0)]
            keys = re.sub(r"(min|max): ([^,}]*)", rf'\1: "(\2) * {factor!r}"', bound[3])
            # a rate is a number
            if rate := re.search(r"rate: ([\d.]+)", keys):
                keys = keys.replace(rate[0], f"rate: {float(rate[1]) * factor!r}")
            line = f"    {bound[1]}{bound[2]}: {{{keys}}}"
        lines.append(line)
    return "\n".join(lines)


def _ends(units: Units, control: str) -> str:
    end = _RANGE * units.controls[int(control or 0)]
    return f"[{-end!r}, {end!r}]"


def _read(expression: str, units: Units) -> str:
    """The expression with states and controls converted back to its original units."""

    def divided(found: re.Match[str]) -> str:
        kind = units.states if found["kind"] == "x" else units.controls
        return f"({found[0]} / {kind[int(found['number'] or 0)]!r})"

    # a filter reads its input as it is, and is linear
    filters = r"sum\(h\d\(u\)\)|h\d\(u0\)"
    parts = re.split(f"({filters})", expression)
    names = r"\b(?P<kind>[xu])(?P<number>\d?)\b(\[t-\d+\])?"
    return "".join(
        f"({part} / {units.controls[0]!r})"
        if re.fullmatch(filters, part)
        else re.sub(names, divided, part)
        for part in parts
    )


@dataclass(frozen=True, slots=True)
class Problem:
    """An initial state and references of a problem, in the original units."""

    state: Array
    references: Mapping[str, Array]


def drawn_problem(plant: Plant, problem: ControlProblem, random: np.random.Generator) -> Problem:
    """A random problem: states far from 0, weights of 0, limits that are equal or contradict each
    other.
    """
    state = random.normal(size=problem.states.size) * random.choice([0.1, 1.0, 3.0, 10.0])
    known = {"r": float(random.normal()), "s": float(random.normal()) ** 2}
    known["top"] = float(random.choice([0.2, 1.0, 5.0]))
    for name in WEIGHTS:
        known[name] = 0.0 if random.uniform() < 0.1 else float(10.0 ** random.uniform(-3, 2))
    for low in (name for name in plant.known if name.startswith("lo")):
        width = random.choice([0.0, 0.5, 2.0, 20.0, -1.0], p=[0.05, 0.3, 0.5, 0.1, 0.05])
        middle = float(random.normal())
        known[low], known["hi" + low[2:]] = middle - width / 2, middle + width / 2
    if plant.is_vector:
        for end in ("lo", "hi"):
            known |= {end: np.array([known.pop(f"{end}{j}") for j in range(2)])}
    rows = problem.horizon + 1
    return Problem(
        state,
        {
            member.name: np.repeat(np.asarray(known[member.name], float)[None], rows, axis=0)
            for member in problem.references.members
        },
    )


@dataclass(frozen=True, slots=True)
class Solved:
    """The result of a solver for one problem, with controls in the original units."""

    status: int
    iterations: int
    residual: float
    control: tuple[float, ...]

    def equals(self, other: Solved) -> bool:
        """True if every bit is equal."""
        mine, theirs = np.array(self.control), np.array(other.control)
        is_same = self.status == other.status
        # a plan that runs away ends where numbers do, in single precision soon
        if self.status != Status.INFEASIBLE:
            is_same &= (self.iterations, self.residual) == (other.iterations, other.residual)
        return is_same and bool(np.array_equal(mine, theirs))


class PlantInUnits:
    """A plant in some units: its problem, and the factors of its values."""

    def __init__(self, plant: Plant, units: Units, structure: Chosen, folder: Path) -> None:
        path = folder / "drawn.msnn.yaml"
        path.write_text(in_units(plant, units), encoding="utf-8")
        control = msnn.load(path).of(ControlProblem)
        assert control is not None
        weights = initial_weights(control.program)
        self.problem = trained(replace(control, structure=structure), weights)
        of_control = {
            member.name: units.controls[int(member.name[1:] or 0)]
            for member in self.problem.controls.members
        }
        held = signals_held(self.problem.program)
        self._states = np.concatenate(
            [
                np.full(
                    member.size,
                    units.states[int(member.name[1:])]
                    if re.fullmatch(r"x\d", member.name)
                    else of_control.get(held.get(member.name, ""), 1.0),
                )
                for member in self.problem.states.members
            ]
        )
        members = self.problem.controls.members
        self._controls = np.concatenate([np.full(m.size, of_control[m.name]) for m in members])
        self._folder = folder

    def in_c(self, problems: Sequence[Problem], dtype: Dtype) -> list[Solved]:
        """Solves one after the other; then the last one again by prepare and feedback."""
        folder = self._folder / dtype
        for name, text in controller_texts(self.problem, "drawn", dtype).items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text, encoding="utf-8")
        built = build_library(folder, folder / "drawn.so", flags=("-O0",))
        library = ControllerLibrary.of_folder(folder, built)
        fields = {field.name: field for field in input_fields(self.problem)}
        found: list[Solved] = []
        for number, problem in enumerate([*problems, problems[-1]]):
            values = {
                fields[name].identifier: samples[: fields[name].samples]
                for name, samples in problem.references.items()
            }
            values["x"] = problem.state * self._states
            if number < len(problems):
                decision = library.solve(values)
            else:
                library.prepare()
                decision = library.feedback(values)
            control = tuple((decision.control.astype(np.float64) / self._controls).tolist())
            found.append(Solved(decision.status, decision.iterations, decision.residual, control))
        return found

    def in_python(self, problems: Sequence[Problem]) -> list[Solved]:
        """Solves one after the other by the method in Python, where limits leave controls room."""
        functions = HorizonFunctions(self.problem)
        method = ReferenceMethod(self.problem, functions)
        resting = functions.resting
        found: list[Solved] = []
        for problem in problems:
            given = Given(problem.state * self._states, {}, problem.references)
            allowed = ControlRange(functions, functions.limits(given), given.state)
            if not allowed.is_possible:
                found.append(Solved(2, 0, 0.0, ()))
                continue
            solved = method.solve(given, allowed, resting)
            control = tuple((solved.plan.controls[0] / self._controls).tolist())
            found.append(Solved(int(solved.status), solved.iterations, solved.residual, control))
        return found


def compare_plant(number: int, random: np.random.Generator) -> Counter[str]:
    """Compares one random plant in several units; returns counts of comparisons and of
    differences.
    """
    plant = drawn_plant(random, has_blocks=number % 4 == 3)
    structure: Chosen = "condensed" if (number + number // 4) % 2 else "staged"
    counts: Counter[str] = Counter()
    problems: list[Problem] = []
    first: dict[str, list[Solved]] = {}
    drawn = {
        "first": SAME,
        "powers of two": Units.drawn(random, 2.0, 20, whole=True),
        "others": Units.drawn(random, 10.0, 6, whole=False),
    }
    for kind, units in drawn.items():
        with tempfile.TemporaryDirectory() as place, tempfile.TemporaryDirectory() as other:
            own = PlantInUnits(plant, units, structure, Path(place))
            single = PlantInUnits(plant, units.nearer(), structure, Path(other))
            if not problems:
                problems = [drawn_problem(plant, own.problem, random) for _ in range(EACH)]
            solved = {
                "C, float64": own.in_c(problems, "float64"),
                "C, float32": single.in_c(problems, "float32"),
                "Python": own.in_python(problems),
            }
        first = first or solved
        for solver, found in solved.items() if kind != "first" else ():
            for mine, wanted in zip(found, first[solver], strict=True):
                counts[f"{solver}, {kind}"] += 1
                is_exact = kind == "powers of two"
                is_same = mine.equals(wanted) if is_exact else mine.status == wanted.status
                counts[f"{solver}, {kind}, not the same"] += not is_same
    for one in first["C, float64"]:
        counts[Status(one.status).name] += 1
    return counts


def main() -> None:
    """Draws, compares and prints."""
    numbers = [int(each) for each in sys.argv[1:] if each.isdecimal()]
    count, seed = [*numbers, *(500, 0)[len(numbers) :]]
    begun, counts = time.perf_counter(), Counter[str]()
    for number in range(-(-count // EACH)):
        counts += compare_plant(number, np.random.default_rng([seed, number]))
        print(f"{EACH * (number + 1)} problems, {time.perf_counter() - begun:.0f} s", flush=True)
    page = _page(count, seed, counts)
    print(page)
    if "--write" in sys.argv:
        RESULTS.write_text(page, encoding="utf-8")


def _table(counts: Counter[str]) -> list[str]:
    lines = ["| solver | factors | solves | not the same | same |", "|---|---|---|---|---|"]
    for name in sorted(n for n in counts if "," in n and not n.endswith("not the same")):
        all_of, others = counts[name], counts[f"{name}, not the same"]
        solver, kind = name.rsplit(", ", 1)
        lines.append(f"| {solver} | {kind} | {all_of} | {others} | {1 - others / all_of:.2%} |")
    return lines


def _page(count: int, seed: int, counts: Counter[str]) -> str:
    statuses = ", ".join(f"{counts[s.name]} {s.name}" for s in Status if counts[s.name])
    table = "\n".join(_table(counts))
    return f"""# Random problems in other units

`python benchmarks/mpc/other_units.py {count} {seed} --write`: {count} problems of random plants,
written again with other units of states, controls and cost.

{table}

Powers of two, up to 2^±20: status, iterations, residual and controls to the bit. Others, up to
1e±6: the status. In single precision exponents are a third of these. C has one call of prepare and
feedback more for each plant. Statuses of C in double precision in the first units: {statuses}.
"""


if __name__ == "__main__":
    main()

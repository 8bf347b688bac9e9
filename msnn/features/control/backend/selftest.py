"""Writes the C self-test of a controller: inputs it must refuse, solves it must reproduce."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from backends.c_language.literals import Dtype
from backends.c_language.rendering import render
from compiler.ir.types import Type
from msnn.features.control.backend.constants import TypedLiterals, reachable
from msnn.features.control.backend.inputs import SeriesField, input_fields
from msnn.features.control.backend.library import (
    ControllerLibrary,
    Decision,
    compiled_texts,
    multipliers_of,
)
from msnn.features.control.backend.structure.rows import Rows, rows_of
from msnn.features.control.problem.optimal_control import ControlProblem

STARTS = 6


def drawn_starts(problem: ControlProblem, count: int = STARTS) -> list[list[float]]:
    """Draws `count` states x, each within its range or ± its scale.

    The first one is 0, or the value of the range nearest to 0.
    """
    random = np.random.default_rng(0)
    rows: list[list[float]] = []
    for number in range(count):
        row: list[float] = []
        for state in problem.program.states:
            size, scale = Type(state.axes).size, problem.state_scales[state.name]
            low, high = state.range or (-scale, scale)
            drawn = random.uniform(low, high, size)
            nearest = np.clip(np.zeros(size), low, high)
            row += [float(x) for x in (nearest if number == 0 else drawn)]
        rows.append(row)
    return rows


_DRAWS = 16
_BEYOND = (1.0, 3.0, 10.0)
"""Factors on drawn states, disturbances and references."""
_OF_A_KIND = 2
"""Maximum number of recorded initial states per outcome."""
_AGAIN = 0.9
"""Factor on the state for the next solve, which starts from the previous plan."""
_CAPPED = 1
"""The largest status code of a solve that has a plan."""
_CHANGED = 0.5
"""Factor on disturbances and references from one solve to the next."""
_BOUND = 1e-3
"""Tolerance of two checks.

A control is at a limit within this distance, relative to its scale. A soft limit is violated if its
multiplier is within this fraction of its linear weight.
"""

Array = NDArray[np.float64]
Call: TypeAlias = Literal[
    "solve", "first solve", "feedback", "prepared feedback", "solve after NaN", "solve after far"
]
"""The function that is called, and its context.

"first solve" follows `init`. "solve after NaN" and "solve after far" follow `reset` with an
impossible control, NaN or `FAR`.
"""
FAR = 1e30
"""A finite control far outside any limit."""
_FEEDBACKS: tuple[Call, ...] = ("feedback", "prepared feedback")
_APPLIED: Mapping[Call, float] = {"solve after NaN": math.nan, "solve after far": FAR}


@dataclass(frozen=True, slots=True)
class GoldenSolve:
    """One call of a controller, with its arguments and its bit-exact results."""

    call: Call
    x: tuple[float, ...]
    known: tuple[float, ...]
    """One sample of each input field except x, repeated along the horizon."""
    status: int
    iterations: int
    u: tuple[float, ...]
    residual: float


@dataclass(frozen=True, slots=True)
class _Start:
    """The input of a solve: a state, and one sample of each disturbance and reference."""

    x: Array
    known: tuple[Array, ...]


def golden_solves(
    problem: ControlProblem, texts: Mapping[str, str], name: str
) -> tuple[GoldenSolve, ...] | None:
    """Compiles the files of a controller and records the results of its calls for drawn inputs.
    `name` is its prefix.

    Returns None without a working C compiler.
    """
    built = compiled_texts(texts)
    if built is None:
        return None
    library = ControllerLibrary(json.loads(texts[f"{name}.json"]), built)
    fields, rows = input_fields(problem), rows_of(problem)
    real = library.real
    kinds: dict[tuple[int, bool, bool], int] = {}
    solves: list[GoldenSolve] = []
    for start in _starts(problem, fields, real):
        library.init()
        decision = _solved(library, fields, start)
        kind = (
            decision.status,
            _is_at_a_limit(rows, decision.control),
            _exceeds(problem, rows, library),
        )
        kinds[kind] = kinds.get(kind, 0) + 1
        # a few solves per outcome suffice
        if kinds[kind] > _OF_A_KIND:
            continue
        # an input with a NaN must be refused and leave the plan unchanged
        missing = _missing(start) if not solves else _missing(start)[:1]
        solves.append(_recorded("first solve", start, decision))
        after = missing if kinds[kind] == 1 else []
        later = _after(start, real, known=1.0)
        for then in (*after, later):
            solves.append(_recorded("solve", then, _solved(library, fields, then)))
        if kinds[kind] > 1:
            continue
        # disturbances and references change, so that every value of the plan does
        changed = _after(later, real, known=_CHANGED)
        decision = _solved(library, fields, changed)
        solves.append(_recorded("solve", changed, decision))
        for call in _FEEDBACKS:
            # without a plan, feedback would solve
            if decision.status > _CAPPED:
                break
            changed = _after(changed, real, known=_CHANGED)
            if call == "prepared feedback":
                library.prepare()
            decision = library.feedback(_values(fields, changed))
            solves.append(_recorded(call, changed, decision))
        for call, applied in _APPLIED.items():
            library.reset(np.full(problem.controls.size, applied))
            solves.append(_recorded(call, start, _solved(library, fields, start)))
    return tuple(solves)


def _missing(start: _Start) -> list[_Start]:
    """Returns copies of an input, each with one element replaced by NaN."""
    numbers = np.concatenate([start.x, *start.known])
    ends = np.cumsum([len(start.x), *(len(values) for values in start.known)])[:-1]
    starts: list[_Start] = []
    for k in range(len(numbers)):
        x, *known = np.split(np.where(np.arange(len(numbers)) == k, np.nan, numbers), ends)
        starts.append(_Start(x, tuple(known)))
    return starts


def _after(start: _Start, real: np.dtype[np.floating], *, known: float) -> _Start:
    """Returns the input of the next solve: a smaller state; `known` scales all other values."""

    def rounded(values: Array) -> Array:
        return values.astype(real).astype(float)

    return _Start(rounded(_AGAIN * start.x), tuple(rounded(known * v) for v in start.known))


def _starts(
    problem: ControlProblem, fields: Sequence[SeriesField], real: np.dtype[np.floating]
) -> list[_Start]:
    """Draws the inputs of first solves, from the declared ranges and beyond."""
    random = np.random.default_rng(2)
    starts: list[_Start] = []
    for beyond in _BEYOND:
        for drawn in drawn_starts(problem, _DRAWS):
            # rounded to the C type, so that Python and C solve the same problem
            x = (beyond * np.array(drawn)).astype(real).astype(float)
            known = [random.uniform(-beyond, beyond, field.count) for field in fields]
            rounded = (values.astype(real).astype(float) for values in known)
            starts.append(_Start(x, tuple(rounded)))
    return starts


def _solved(library: ControllerLibrary, fields: Sequence[SeriesField], start: _Start) -> Decision:
    """Solves for this input with the compiled controller; its state changes."""
    return library.solve(_values(fields, start))


def _values(fields: Sequence[SeriesField], start: _Start) -> dict[str, Array]:
    """Returns the input by field name, each sample repeated along the horizon."""
    known = {
        field.identifier: np.tile(values, field.samples)
        for field, values in zip(fields, start.known, strict=True)
    }
    return {"x": start.x} | known


def _recorded(call: Call, start: _Start, decision: Decision) -> GoldenSolve:
    """Records a call with its input and its result."""
    return GoldenSolve(
        call=call,
        x=tuple(start.x.tolist()),
        known=tuple(float(x) for values in start.known for x in values),
        status=decision.status,
        iterations=decision.iterations,
        u=tuple(float(u) for u in decision.control),
        residual=decision.residual,
    )


def _is_at_a_limit(rows: Rows, control: NDArray[np.floating]) -> bool:
    """Returns True if any control is at one of its limits."""
    near = (
        abs(float(u) - end) <= _BOUND * row.scale
        for u, row in zip(control, rows.rows, strict=False)
        for end in (row.minimum, row.maximum)
        if end is not None
    )
    return any(near)


def _exceeds(problem: ControlProblem, rows: Rows, library: ControllerLibrary) -> bool:
    """Returns True if a soft limit is violated: its multiplier is then at least its weight w₁."""
    multipliers = multipliers_of(problem, rows, library)
    return any(
        bool(np.any(side >= (1 - _BOUND) * path.linear))
        for path, low, high in zip(
            problem.path_limits, multipliers.path_min, multipliers.path_max, strict=True
        )
        if path.linear is not None
        for side in (low, high)
    )


@dataclass(frozen=True, slots=True)
class SelfTest:
    """The names that the template of a self-test needs."""

    model: str
    prefix: str
    takes_parameters: bool = False


def selftest_texts(
    problem: ControlProblem, prefix: str, dtype: Dtype, texts: Mapping[str, str]
) -> dict[str, str]:
    """Returns the text of `src/<prefix>_mpc_selftest.c`, by path.

    `texts` are the other files of the controller, which are compiled to record golden solves. The
    problem must have no parameters.
    """
    problem = replace(problem, tolerance=reachable(problem.tolerance, dtype))
    name = f"{prefix}_mpc"
    numbers, rows = TypedLiterals(dtype), rows_of(problem)
    fields = input_fields(problem)
    counts = [field.count for field in fields]
    controls = rows.rows[: problem.controls.size]
    text = render(
        "selftest.c.j2",
        SelfTest(problem.program.name, name),
        "Self-test of the predictive controller",
        "mpc",
        real=numbers.real,
        num=numbers.literal,
        braced=numbers.braced,
        starts=drawn_starts(problem),
        tolerance=numbers.literal(problem.tolerance),
        nan="NAN" if dtype == "float32" else "(double)NAN",
        lowest=[_end(row.minimum, float("-inf"), rows.move) for row in controls],
        highest=[_end(row.maximum, float("inf"), rows.move) for row in controls],
        fields=[(field, sum(counts[:number])) for number, field in enumerate(fields)],
        known=sum(counts),
        # computed limits may be NaN if the references are 0
        highest_status="INPUT_NOT_FINITE" if rows.move else "INFEASIBLE",
        golden=golden_solves(problem, texts, name) or (),
        calls=get_args(Call),
        far=numbers.literal(FAR),
    )
    return {f"src/{name}_selftest.c": text}


def _end(limit: float | None, without: float, moves: bool) -> float:
    """Returns a constant limit; `without` if there is none or it depends on references."""
    return without if limit is None or moves else limit

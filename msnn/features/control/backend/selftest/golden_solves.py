"""Records what a controller decides, so that other builds can be compared with it to the bit.

Starts are drawn within what the spec declares and beyond it, until each kind of end is there:
solved inside the limits, at a limit of a control, with a soft bound exceeded, capped, infeasible.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from msnn.features.control.backend.inputs import SeriesField, input_fields
from msnn.features.control.backend.library import ControllerLibrary, Decision
from msnn.features.control.backend.selftest.recorded import compiled_texts
from msnn.features.control.backend.selftest.starts import drawn_starts
from msnn.features.control.backend.solution import multipliers_of
from msnn.features.control.backend.structure.rows import Rows, rows_of
from msnn.features.control.problem.optimal_control.problem import ControlProblem

_DRAWS = 16
_BEYOND = (1.0, 3.0, 10.0)
"""Factors of the drawn states."""
_OF_A_KIND = 2
_AGAIN = 0.9
"""The state of the solve that follows, from the plan of the one before."""
_CAPPED = 1
"""The last status that has a plan."""
_CHANGED = 0.5
"""The part of what is known that is left in later solves."""
_BOUND = 1e-3
"""Distance from a limit that counts as at it, by the control's scale; part of the weight of a soft
bound that its multiplier lacks where it is exceeded."""

Array = NDArray[np.float64]
Call: TypeAlias = Literal[
    "solve", "first solve", "feedback", "prepared feedback", "solve after NaN", "solve after far"
]
"""What is called: a first solve after `init`, those after `reset` with a control that nobody can
have applied, NaN or `FAR`."""
FAR = 1e30
_FEEDBACKS: tuple[Call, ...] = ("feedback", "prepared feedback")
_APPLIED: Mapping[Call, float] = {"solve after NaN": math.nan, "solve after far": FAR}


@dataclass(frozen=True, slots=True)
class GoldenSolve:
    """A solve, or a feedback, and its bits."""

    call: Call
    x: tuple[float, ...]
    known: tuple[float, ...]
    """Of each field of the input the numbers of one sample, the same all along the horizon."""
    status: int
    iterations: int
    u: tuple[float, ...]
    residual: float


@dataclass(frozen=True, slots=True)
class _Start:
    x: Array
    known: tuple[Array, ...]


def golden_solves(
    problem: ControlProblem, texts: Mapping[str, str], name: str
) -> tuple[GoldenSolve, ...] | None:
    """The solves of a controller's files; None where nothing compiles them here."""
    built = compiled_texts(texts)
    if built is None:
        return None
    library = ControllerLibrary(json.loads(texts[f"{name}.json"]), built)
    fields, rows = input_fields(problem), rows_of(problem)
    real = library.real
    kinds: dict[tuple[int, bool, bool], int] = {}
    found: list[GoldenSolve] = []
    for start in _starts(problem, fields, real):
        library.init()
        decision = _solved(library, fields, start)
        kind = (
            decision.status,
            _is_at_a_limit(rows, decision.control),
            _exceeds(problem, rows, library),
        )
        kinds[kind] = kinds.get(kind, 0) + 1
        # of each kind of end a few: a test with hundreds would say no more
        if kinds[kind] > _OF_A_KIND:
            continue
        # a number that is NaN must be refused, and leave the plan as it was
        missing = _missing(start) if not found else _missing(start)[:1]
        found.append(_recorded("first solve", start, decision))
        after = missing if kinds[kind] == 1 else []
        later = _after(start, real, known=1.0)
        for then in (*after, later):
            found.append(_recorded("solve", then, _solved(library, fields, then)))
        if kinds[kind] > 1:
            continue
        # what is known changes, so that no value of the plan stays as it was
        changed = _after(later, real, known=_CHANGED)
        decision = _solved(library, fields, changed)
        found.append(_recorded("solve", changed, decision))
        for call in _FEEDBACKS:
            # without a plan it is a solve
            if decision.status > _CAPPED:
                break
            changed = _after(changed, real, known=_CHANGED)
            if call == "prepared feedback":
                library.prepare()
            decision = library.feedback(_values(fields, changed))
            found.append(_recorded(call, changed, decision))
        for call, applied in _APPLIED.items():
            library.reset(np.full(problem.controls.size, applied))
            found.append(_recorded(call, start, _solved(library, fields, start)))
    return tuple(found)


def _missing(start: _Start) -> list[_Start]:
    """The start with each of its numbers in turn NaN."""
    numbers = np.concatenate([start.x, *start.known])
    ends = np.cumsum([len(start.x), *(len(values) for values in start.known)])[:-1]
    found: list[_Start] = []
    for k in range(len(numbers)):
        x, *known = np.split(np.where(np.arange(len(numbers)) == k, np.nan, numbers), ends)
        found.append(_Start(x, tuple(known)))
    return found


def _after(start: _Start, real: np.dtype[np.floating], *, known: float) -> _Start:
    """A place where a plant may be a sample later, what is known times this factor."""

    def rounded(values: Array) -> Array:
        return values.astype(real).astype(float)

    return _Start(rounded(_AGAIN * start.x), tuple(rounded(known * v) for v in start.known))


def _starts(
    problem: ControlProblem, fields: Sequence[SeriesField], real: np.dtype[np.floating]
) -> list[_Start]:
    random = np.random.default_rng(2)
    found: list[_Start] = []
    for beyond in _BEYOND:
        for drawn in drawn_starts(problem, _DRAWS):
            # numbers of the type, so that Python and C solve the same problem
            x = (beyond * np.array(drawn)).astype(real).astype(float)
            known = [random.uniform(-beyond, beyond, field.count) for field in fields]
            rounded = (values.astype(real).astype(float) for values in known)
            found.append(_Start(x, tuple(rounded)))
    return found


def _solved(library: ControllerLibrary, fields: Sequence[SeriesField], start: _Start) -> Decision:
    return library.solve(_values(fields, start))


def _values(fields: Sequence[SeriesField], start: _Start) -> dict[str, Array]:
    known = {
        field.identifier: np.tile(values, field.samples)
        for field, values in zip(fields, start.known, strict=True)
    }
    return {"x": start.x} | known


def _recorded(call: Call, start: _Start, decision: Decision) -> GoldenSolve:
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
    near = (
        abs(float(u) - end) <= _BOUND * row.scale
        for u, row in zip(control, rows.rows, strict=False)
        for end in (row.minimum, row.maximum)
        if end is not None
    )
    return any(near)


# z of a soft bound is at most w₁ where nothing exceeds it
def _exceeds(problem: ControlProblem, rows: Rows, library: ControllerLibrary) -> bool:
    """Whether a soft bound is exceeded: its multiplier is its weight then."""
    found = multipliers_of(problem, rows, library)
    return any(
        bool(np.any(side >= (1 - _BOUND) * path.linear))
        for path, low, high in zip(problem.path_limits, found.path_min, found.path_max, strict=True)
        if path.linear is not None
        for side in (low, high)
    )

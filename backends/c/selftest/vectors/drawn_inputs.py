"""Draws what golden vectors begin with: samples around t0 and inputs, some of them invalid."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, assert_never

import numpy as np
from numpy.typing import DTypeLike, NDArray

from backends.c.interface.interface import InputField
from backends.c_language.literals import Dtype
from compiler.ir.liveness import extents
from compiler.ir.ops import Constant
from compiler.ir.program import Program, Signal

Array = NDArray[Any]

_SPECIAL_EVERY = 5
"""Steps from one value at a knot to the next, and from one invalid value that the policy replaces
to the next."""


@dataclass(frozen=True, slots=True)
class StartPoint:
    """The start of a run's states: part `part` of `parts` of the range of each."""

    part: int = 0
    parts: int = 1
    knot: Literal["at", "below"] | None = None
    """At the nearest number of the program or just below: intervals of tables meet there."""


Outside = Literal["above", "below", "far above", "far below", "nan"]
"""Beyond which limit of its range a number is, or none."""


@dataclass(frozen=True, slots=True)
class DrawnRecord:
    """The measurements around the first step, (rows, *shape) by name."""

    log: dict[str, Array]
    t0: int
    """The row of the first step."""


def drawn_record(
    program: Program,
    random: np.random.Generator,
    start: StartPoint | Outside,
    dtype: Dtype,
    *,
    invalid: int | None = None,
) -> DrawnRecord:
    """A record as long as the start graph needs.

    With `invalid` the first samples, and of the others every second or so, are invalid where the
    policy replaces them: by turns of each kind, beginning with that one.
    """
    # rounded to the type of the code first: the number beside a threshold is another one in float32
    knots = knots_of(program, dtype)
    reads = extents(program.start, log=True)
    # as little of the past as the start reads: a golden vector is data in somebody's flash
    t0 = max([0, *(-extent.first for extent in reads.values())])
    rows = t0 + 1 + max([0, *(extent.last for extent in reads.values())])
    # a measured state starts anywhere in its range
    ranges = {state.name: state.range for state in program.states}
    log: dict[str, Array] = {}
    for number, name in enumerate(reads):
        signal = program.signal(name)
        shape = tuple(axis.size for axis in signal.axes)
        # past samples of inputs out of range would drive a state far from its limit at once
        here = (
            start
            if name in ranges or isinstance(start, StartPoint) or start == "nan"
            else StartPoint()
        )
        low, high = _within(drawable(signal.range or ranges.get(name)), here, number)
        if isinstance(start, StartPoint) and start.knot is not None and knots.size:
            low = high = _nearest(knots, (low + high) / 2.0, below=start.knot == "below")
        log[name] = (low + (high - low) * random.random((rows, *shape))).astype(dtype)
        if invalid is not None and signal.on_invalid in ("clamp", "hold"):
            chosen = random.random(log[name].shape) < 0.5
            # everything up to the oldest sample that is read: `hold` has nothing valid to fall back
            # to there
            chosen[: t0 + reads[name].first + 1] = True
            kinds = np.roll([*_invalid(signal, dtype), *_NO_NUMBERS], -invalid)
            log[name][chosen] = np.resize(kinds, chosen.sum())
    return DrawnRecord(log, t0)


def knots_of(program: Program, dtype: Dtype) -> Array:
    """The numbers in a step: what decides between branches is among them."""
    numbers = {
        x for _, node in program.step if isinstance(node.op, Constant) for x in node.op.values
    }
    return np.array(sorted(x for x in numbers if math.isfinite(x)), dtype)


def drawn_series(
    input: InputField,
    steps: int,
    random: np.random.Generator,
    knots: Array,
    opening: int = 0,
    *,
    turn: int = 0,
) -> Array:
    """Values of an input, (steps, *shape), within its range or [-1, 1] but for invalid ones.

    Some lie at one of the knots or at a limit, some just below, some a little above; the last but
    one are 0 where that is valid. Some values come twice in a row.

    Where the policy replaces invalid values there are some of each kind, in other steps for inputs
    with another `turn`, as one bit tells of all inputs; where it flags them, one
    is the next number above the range and one far above it, and below, and one is NaN in the last
    step, as it would spoil what follows. Where they are trusted there is that alone. The first
    `opening` samples are invalid in every element: of all kinds where they are replaced, else just
    outside the range.
    """
    signal = input.port.signal
    # drawn in double and rounded: both types see the same points of the range
    low, high = drawable(signal.range)
    series = random.uniform(low, high, (steps, *input.field.shape)).astype(knots.dtype)
    rows = series.reshape(steps, -1)

    def put(at: Array, values: Array) -> None:
        """Into one element of each of these rows."""
        rows[at, random.integers(rows.shape[1], size=len(at))] = np.resize(values, len(at))

    again = np.arange(_SPECIAL_EVERY - 1, steps, _SPECIAL_EVERY)
    # the same input twice shows what depends on the state alone
    rows[again] = rows[again - 1]
    ends = [end for end in signal.range or () if math.isfinite(end)]
    inside = np.append(knots[(knots >= low) & (knots <= high)], ends).astype(knots.dtype)
    if inside.size:
        at = np.arange(0, steps, _SPECIAL_EVERY)
        chosen = random.choice(inside, len(at))
        # one number beside a threshold is what tells < from <=
        below = np.nextafter(chosen, knots.dtype.type(low))
        above = np.minimum(chosen + _NEAR * random.random(len(at)) * np.abs(chosen), high)
        put(at, np.choose(random.integers(3, size=len(at)), [chosen, below, above]))
    if steps > 1 and low <= 0.0 <= high:
        rows[-2] = 0.0
    invalid, last = _invalid(signal, knots.dtype), np.array([steps - 1])
    match signal.on_invalid:
        case "clamp" | "hold":
            kinds = np.array([*invalid, *_NO_NUMBERS])
            at = np.arange((_SPECIAL_EVERY // 2 + turn) % _SPECIAL_EVERY, steps, _SPECIAL_EVERY)
            put(at, np.roll(kinds, random.integers(len(kinds))))
        case "flag" if steps > 1:
            at = 1 + np.arange(len(invalid)) * steps // max(1, len(invalid))
            put(at, np.array(invalid))
            put(last, np.array(math.nan))
        case "trust" if steps > 1:
            put(last, np.array(math.nan))
        case _:
            pass
    first = rows[:opening]
    replaced = signal.on_invalid in ("clamp", "hold")
    kinds = np.array([*invalid, *_NO_NUMBERS] if replaced else beside(signal.range, knots.dtype))
    if first.size and kinds.size:
        first[:] = np.resize(np.roll(kinds, random.integers(kinds.size)), first.shape)
    return series


def _within(
    limits: tuple[float, float], start: StartPoint | Outside, shift: int
) -> tuple[float, float]:
    """The limits to draw a start between; `shift` puts signals of a run in different parts."""
    low, high = limits
    if isinstance(start, StartPoint):
        width = (high - low) / start.parts
        here = low + width * ((start.part + shift) % start.parts)
        return here, here + width
    return outside(limits, start), outside(limits, start)


def outside(limits: tuple[float, float], where: Outside) -> float:
    """A number beyond these limits, or none."""
    low, high = limits
    match where:
        case "above":
            return high + _little(high - low, high)
        case "below":
            return low - _little(high - low, low)
        case "far above":
            return 2.0 * high - low
        case "far below":
            return 2.0 * low - high
        case "nan":
            return math.nan
        case _:
            assert_never(where)


def _little(width: float, limit: float) -> float:
    """Little enough that a limit which is a little wrong is noticed."""
    return max(width * _BESIDE, abs(limit) * _ROUNDING)


_BESIDE, _ROUNDING, _FAR, _NEAR = 4e-3, 2.0**-20, 1e3, 1e-2
"""How far just outside is, of the range and of its limit: more than float32 rounds away; how far
is far, and how much of a knot is a little."""


def drawable(range: tuple[float, float] | None) -> tuple[float, float]:
    """Finite limits to draw between."""
    if range is None:
        return -1.0, 1.0
    low, high = range
    if math.isfinite(low):
        return low, high if math.isfinite(high) else low + 2.0
    return (high - 2.0, high) if math.isfinite(high) else (-1.0, 1.0)


def _invalid(signal: Signal, dtype: DTypeLike) -> list[float]:
    """Values of every kind that is invalid: just and far outside the range, and no numbers."""
    far: list[float] = []
    if signal.range is not None:
        low, high = signal.range
        limits = drawable(signal.range)
        away = _FAR * (1.0 + limits[1] - limits[0])
        if math.isfinite(high):
            far.append(high + away)
        if math.isfinite(low):
            far.append(low - away)
    return [*beside(signal.range, dtype), *far]


_NO_NUMBERS = (math.nan, math.inf, -math.inf)


def beside(range: tuple[float, float] | None, dtype: DTypeLike) -> list[float]:
    """The next numbers above and below a range, where it has these limits."""
    ends = ((range[1], math.inf), (range[0], -math.inf)) if range is not None else ()
    numbers = np.array([pair for pair in ends if math.isfinite(pair[0])], dtype).reshape(-1, 2)
    return [float(x) for x in np.nextafter(numbers[:, 0], numbers[:, 1])]


def _nearest(knots: Array, x: float, *, below: bool) -> float:
    nearest = knots[np.argmin(np.abs(knots - x))]
    return float(np.nextafter(nearest, knots.dtype.type(-np.inf)) if below else nearest)

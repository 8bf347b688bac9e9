"""Draws the data of golden vectors: samples around t0 and inputs, some of them invalid."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal, assert_never

import numpy as np
from numpy.typing import DTypeLike, NDArray

from backends.c.interface.interface import InputField
from backends.c_language.literals import Dtype
from compiler.ir.nodes import extents
from compiler.ir.ops import Constant
from compiler.ir.program import Program, Signal

Array = NDArray[Any]

_SPECIAL_EVERY = 5
"""Period in steps of values at a knot, and of invalid values that the policy replaces."""


@dataclass(frozen=True, slots=True)
class StartPoint:
    """The part of the ranges in which a golden run draws its initial states: each range is split
    into `parts` equal parts, and part number `part` is used.
    """

    part: int = 0
    parts: int = 1
    knot: Literal["at", "below"] | None = None
    """Starts at the nearest constant of the program, or at the next value below it.

    Intervals of lookup tables meet at such constants."""


Outside = Literal["above", "below", "far above", "far below", "nan"]
"""The side and distance by which a value is outside its range, or NaN."""


@dataclass(frozen=True, slots=True)
class DrawnRecord:
    """Random samples around the first step of a golden run, as if measured: (rows, *shape) by name
    of signal.
    """

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
    """Draws samples of the signals that the start graph reads, just enough rows for it. `start` is
    the part of the ranges, or the side outside of them, from which they are drawn. If `invalid` is
    an index, samples of signals with policy clamp or hold are replaced by invalid values: all up to
    the oldest sample that is read, and half of the others. The kinds of invalid values take turns,
    from this index on.
    """
    # rounded to the code's type first: the value next to a threshold differs in float32
    knots = knots_of(program, dtype)
    reads = extents(program.start, log=True)
    # as few past samples as the start reads: golden vectors take flash memory on the target
    t0 = max([0, *(-extent.first for extent in reads.values())])
    rows = t0 + 1 + max([0, *(extent.last for extent in reads.values())])
    # a measured state starts anywhere in its range
    ranges = {state.name: state.range for state in program.states}
    log: dict[str, Array] = {}
    for number, name in enumerate(reads):
        signal = program.signal(name)
        shape = tuple(axis.size for axis in signal.axes)
        # past inputs out of range would move a state far from its limit in one step
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
    """All finite constants of the step graph, sorted, in the type of the code. Thresholds of
    branches and knots of lookup tables are among them.
    """
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
    """Draws values of an input, (steps, *shape): within its range, or [-1, 1] without one, and some
    invalid ones. Some values lie at a limit or one of `knots`, some just below or slightly above
    it. Some rows repeat the row before. The last row but one is 0 if 0 is in the range.

    Invalid values depend on the policy of the input:

    - clamp, hold: all kinds of invalid values occur. Inputs with different `turn` have them in
      different steps, because one status bit covers all inputs.
    - flag: values just and far outside both limits, and NaN in the last step, as NaN would spoil
      later steps.
    - trust: only NaN in the last step.

    In the first `opening` samples all elements are invalid: of all kinds for clamp and hold,
    otherwise just outside the range.
    """
    signal = input.port.signal
    # drawn in float64, then rounded: both types get the same points of the range
    low, high = drawable(signal.range)
    series = random.uniform(low, high, (steps, *input.field.shape)).astype(knots.dtype)
    rows = series.reshape(steps, -1)

    def put(at: Array, values: Array) -> None:
        """Writes one of `values` to a random element of each row in `at`, in turn."""
        rows[at, random.integers(rows.shape[1], size=len(at))] = np.resize(values, len(at))

    again = np.arange(_SPECIAL_EVERY - 1, steps, _SPECIAL_EVERY)
    # repeated inputs show effects of the state alone
    rows[again] = rows[again - 1]
    ends = [end for end in signal.range or () if math.isfinite(end)]
    inside = np.append(knots[(knots >= low) & (knots <= high)], ends).astype(knots.dtype)
    if inside.size:
        at = np.arange(0, steps, _SPECIAL_EVERY)
        chosen = random.choice(inside, len(at))
        # only values next to a threshold distinguish < from <=
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
    """The (low, high) between which a start is drawn: a part of `limits`, or one point outside of
    them. Signals of one run use different parts, as `shift` is their number.
    """
    low, high = limits
    if isinstance(start, StartPoint):
        width = (high - low) / start.parts
        here = low + width * ((start.part + shift) % start.parts)
        return here, here + width
    return outside(limits, start), outside(limits, start)


def outside(limits: tuple[float, float], where: Outside) -> float:
    """A value on the side `where` of the finite `limits` (low, high), or NaN. The far ones are as
    far from a limit as the range is wide.
    """
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
    """A distance from `limit` just large enough to detect a slightly wrong limit in the code.
    `width` is that of the range.
    """
    return max(width * _BESIDE, abs(limit) * _ROUNDING)


_BESIDE, _ROUNDING, _FAR, _NEAR = 4e-3, 2.0**-20, 1e3, 1e-2
"""Relative distances of drawn values.

`_BESIDE` (of the width of the range) and `_ROUNDING` (of the limit) are just outside, but more than
the rounding of float32. `_FAR` is far outside, `_NEAR` slightly above a knot.
"""


def drawable(range: tuple[float, float] | None) -> tuple[float, float]:
    """Finite (low, high) to draw values between: the range itself, [-1, 1] without one, and for one
    infinite limit a range of width 2.
    """
    if range is None:
        return -1.0, 1.0
    low, high = range
    if math.isfinite(low):
        return low, high if math.isfinite(high) else low + 2.0
    return (high - 2.0, high) if math.isfinite(high) else (-1.0, 1.0)


def _invalid(signal: Signal, dtype: DTypeLike) -> list[float]:
    """Finite invalid values of a signal: the next value beyond each finite limit, and one far
    beyond each.
    """
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
    """The next value of this type above the range and the next one below it; a side without finite
    limit has none.
    """
    ends = ((range[1], math.inf), (range[0], -math.inf)) if range is not None else ()
    numbers = np.array([pair for pair in ends if math.isfinite(pair[0])], dtype).reshape(-1, 2)
    return [float(x) for x in np.nextafter(numbers[:, 0], numbers[:, 1])]


def _nearest(knots: Array, x: float, *, below: bool) -> float:
    nearest = knots[np.argmin(np.abs(knots - x))]
    return float(np.nextafter(nearest, knots.dtype.type(-np.inf)) if below else nearest)


Limits = tuple[float, float]


def drawn_starts(
    program: Program, random: np.random.Generator, dtype: Dtype, unroll: int
) -> Iterator[DrawnRecord]:
    """Samples around t0 that test the range checks of `reset`: first one record at all lower
    limits, one at all upper limits, then records with exactly one invalid sample. In signals of up
    to `unroll` elements each element is invalid once in every way, because generated C has a
    statement for each. In larger signals, which C checks in a loop, only the first, last and middle
    element take turns.
    """
    ranges = {state.name: state.range for state in program.states}
    reads = extents(program.start, log=True)
    limits = {
        name: [known for known in (program.signal(name).range, ranges.get(name)) if known]
        for name in reads
    }
    for end in (0, 1):
        record = drawn_record(program, random, StartPoint(), dtype)
        for name, series in record.log.items():
            # exactly at a limit: `reset` must not report valid samples
            series[:] = _common(limits[name])[end]
        yield record
    for name, extent in reads.items():
        size = math.prod(axis.size for axis in program.signal(name).axes)
        count = size * (extent.last - extent.first + 1)
        for turn, value in enumerate(_invalid_in_window(limits[name], dtype)):
            for element in _elements(count, unroll, turn):
                record = drawn_record(program, random, StartPoint(), dtype)
                for other, series in record.log.items():
                    # all other samples are valid, so that the status shows this check alone
                    np.clip(series, *_common(limits[other]), out=series)
                begin = size * (record.t0 + extent.first)
                record.log[name].reshape(-1)[begin + element] = value
                yield record


def _common(limits: list[Limits]) -> Limits:
    """Finite limits (low, high) of the intersection of these ranges, to draw between."""
    low = max((low for low, _ in limits), default=-math.inf)
    high = min((high for _, high in limits), default=math.inf)
    return drawable((low, high))


def _invalid_in_window(limits: list[Limits], dtype: Dtype) -> list[float]:
    """Values that a check of these ranges must reject: the next value beyond each limit, NaN, and
    ±∞ if one side has no limit.
    """
    found = [value for known in limits for value in beside(known, dtype)]
    bounded = all(any(math.isfinite(known[end]) for known in limits) for end in (0, 1))
    return [*found, math.nan, *(() if bounded else (math.inf, -math.inf))]


def _elements(count: int, unroll: int, turn: int) -> list[int]:
    if count <= unroll:
        return list(range(count))
    return [(0, count - 1, count // 2)[turn % 3]]

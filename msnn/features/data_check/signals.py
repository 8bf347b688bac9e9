"""Analyses a single series: values, spikes, saturation, quantisation, plausible units."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from msnn.data.dataset import BoolArray, FloatArray, IntArray
from spec_schema.units.parser import parse_unit
from spec_schema.units.unit import Unit

Side = Literal["largest", "smallest"]

SHORTEST = 3
"""Minimum number of rows at a limit."""
_FEW_LEVELS = 16
"""A signal with so few values is switched, not saturated."""
_NEAR = 0.02
"""Width of the comparison band below a limit, relative to the span."""
_CROWDED = 3.0
"""Minimum ratio of rows at the limit and in the comparison band.

A quantised sine is √2 + 1 = 2.41 times as often at its maximum as at the next value.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Saturation:
    """A limit at which a series stays."""

    side: Side
    value: float
    rows: int
    longest: int
    """Rows of the longest interval at the limit."""
    first: int
    """First row of the longest interval."""


def saturation(values: FloatArray, follows: BoolArray) -> tuple[Saturation, ...]:
    """The saturation limits of a series.

    A series must stay at the limit for three rows or more, longer than usual at other values;
    otherwise a staircase would be saturated. It must also be there much more often than at
    neighbouring values; otherwise the rounded top of a wave would be.
    """
    known = np.isfinite(values)
    if known.sum() < 2 * SHORTEST:
        return ()
    low, high = float(np.min(values[known])), float(np.max(values[known]))
    if low == high or _levels(values[known]) <= _FEW_LEVELS:
        return ()
    # stays: runs of equal values that follow each other
    begins = np.flatnonzero(np.concatenate(([True], (np.diff(values) != 0) | ~follows[1:])))
    lengths = np.diff(np.concatenate((begins, [len(values)])))
    at = values[begins]
    found: list[Saturation] = []
    near = _NEAR * (high - low)
    sides: tuple[tuple[Side, float, BoolArray], ...] = (
        ("largest", high, (values < high) & (values >= high - near)),
        ("smallest", low, (values > low) & (values <= low + near)),
    )
    for side, value, band in sides:
        stays, others = at == value, np.isfinite(at) & (at != low) & (at != high)
        longest = int(lengths[stays].max())
        rows = int(lengths[stays].sum())
        # by rows, not by stays: how long the stay is in which a row is found
        usual = float(np.sum(lengths[others] ** 2) / np.sum(lengths[others]))
        # what is beside the limit in value: a wave that is cut jumps over it
        beside = max(int(band.sum()), _next_level(values[known], value))
        if longest >= SHORTEST and longest > 3 * usual and rows > _CROWDED * beside:
            first = int(begins[stays][np.argmax(lengths[stays])])
            found.append(
                Saturation(side=side, value=value, rows=rows, longest=longest, first=first)
            )
    return tuple(found)


def _levels(values: FloatArray) -> int:
    """The number of distinct values; counting stops if there are clearly many."""
    # a look at the first rows: sorting all would take the time of reading
    few = np.unique(values[: 64 * _FEW_LEVELS])
    return len(few) if len(few) > _FEW_LEVELS else len(np.unique(values))


def _next_level(values: FloatArray, limit: float) -> int:
    """Number of rows at the value nearest to the limit."""
    others = values[values != limit]
    nearest = others[np.argmin(np.abs(others - limit))]
    return int(np.sum(values == nearest))


WIDEST = 3
"""Maximum width of a spike in rows."""
FALSE_ALARMS = 0.01
"""Maximum expected number of spikes in a recording of Gaussian noise."""
_AROUND = 8
"""Rows on each side of a spike whose variation is compared with it."""
_PER_DEVIATION = 1.4826
"""Standard deviation of Gaussian noise divided by the median of its magnitude."""


@dataclass(frozen=True, slots=True)
class Spikes:
    """The first row, height and width of each spike."""

    rows: IntArray
    heights: FloatArray
    widths: IntArray

    def __len__(self) -> int:
        return len(self.rows)


def without_spikes(values: FloatArray, found: Spikes) -> FloatArray:
    """The series with spikes replaced by linear interpolation."""
    values = values.copy()
    for row, width in zip(found.rows.tolist(), found.widths.tolist(), strict=True):
        before, after = values[row - 1], values[row + width]
        values[row : row + width] = np.linspace(before, after, width + 2)[1:-1]
    return values


def spikes(values: FloatArray, follows: BoolArray) -> Spikes:
    """The spikes of a series with at most three rows; `follows` marks rows without a gap before.

    A spike of w rows begins at i if the differences d[i] and d[i+w] are both large and opposite,
    and the signal returns to its value. The threshold is s·√(2 ln(N/0.01)) with the standard
    deviation s from the median of |d|: of N Gaussian differences, fewer than 0.01 exceed it (Q(k) ≤
    exp(−k²/2)/2). Where the signal varies more, the local variation decides. If there are equally
    large jumps without return, the signal has steps, and short steps are not spikes.
    """
    found: list[IntArray] = []
    differences = np.diff(values)
    # across a gap there is no difference
    differences[~follows[1:]] = np.nan
    magnitudes = np.abs(differences)
    known = magnitudes[np.isfinite(magnitudes)]
    scale = _scale(known)
    # a series that stands still has no spikes
    if scale == 0:
        return _NONE
    limit = scale * math.sqrt(2 * math.log(len(known) / FALSE_ALARMS))
    for width in range(1, min(WIDEST, len(differences) - 1) + 1):
        away, back = differences[:-width], differences[width:]
        smaller = np.minimum(np.abs(away), np.abs(back))
        # away and back: of opposite sign, and as large
        there = (smaller > limit) & (away * back < 0) & (np.abs(away + back) < 0.5 * smaller)
        # wider ones must come back to where they were, not only turn
        if width > 1:  # the rows between stay up
            returned = np.abs(values[width + 1 :] - values[: -width - 1])
            there &= returned < 0.5 * smaller
        found.append(np.flatnonzero(there) + 1)
    rows, widths = _apart(found)
    heights = magnitudes[rows - 1]
    local = _motion_around(magnitudes, rows)
    # where the signal moves anyway, a spike must stand out of that
    kept = heights > local * limit / scale
    rows, heights, widths = rows[kept], heights[kept], widths[kept]
    rare = _rare(heights, np.sort(known[known > limit]))
    return Spikes(rows[rare], heights[rare], widths[rare])


_NONE = Spikes(np.zeros(0, np.int64), np.zeros(0), np.zeros(0, np.int64))


def _scale(magnitudes: FloatArray) -> float:
    """The standard deviation of usual differences; without zeros if most are 0."""
    if not len(magnitudes):
        return 0.0
    usual = float(np.median(magnitudes))
    if usual == 0:
        moving = magnitudes[magnitudes > 0]
        usual = float(np.median(moving)) if len(moving) else 0.0
    return _PER_DEVIATION * usual


def _apart(found: list[IntArray]) -> tuple[IntArray, IntArray]:
    """First rows and widths; of overlapping spikes only the narrowest."""
    taken: dict[int, int] = {}
    for width, rows in enumerate(found, start=1):
        for row in rows.tolist():
            # a wide one that begins within a narrow one is the same
            if not any(row - k in taken for k in range(WIDEST + 1)) and row + width not in taken:
                taken[row] = width
    rows = sorted(taken)
    return np.array(rows, np.int64), np.array([taken[row] for row in rows], np.int64)


def _motion_around(magnitudes: FloatArray, rows: IntArray) -> FloatArray:
    """The standard deviation of the differences around each spike, without its own."""
    # beside the spike, not within it
    offsets = np.concatenate((np.arange(-_AROUND - 1, -1), np.arange(WIDEST, WIDEST + _AROUND)))
    places = rows[:, None] + offsets
    inside = (places >= 0) & (places < len(magnitudes))
    beside = np.where(inside, magnitudes[np.clip(places, 0, len(magnitudes) - 1)], np.nan)
    known = np.isfinite(beside).any(axis=1)
    found = np.zeros(len(rows))
    if known.any():
        found[known] = np.nanmedian(beside[known], axis=1)
    return _PER_DEVIATION * found


def _rare(heights: FloatArray, jumps: FloatArray) -> BoolArray:
    """Mask of spikes to which most jumps of at least half their height belong, two each."""
    own = np.sort(heights)
    as_high = len(own) - np.searchsorted(own, 0.5 * heights)
    jumping = len(jumps) - np.searchsorted(jumps, 0.5 * heights)
    # two jumps a spike, and twice as many are let pass: a square wave has jumps without spikes
    return 2 * 2 * as_high >= jumping


FEW_LEVELS = 16
"""A signal with so few values is switched between them, not quantised."""
_OFF_GRID = 0.1
"""Maximum distance from the grid, relative to the step, due to printing."""
_ROUNDING = 1e-9
"""Relative distance below which values are equal; unit conversions round them."""


@dataclass(frozen=True, slots=True)
class Quantisation:
    """The quantisation step of a series, and its effect."""

    step: float
    levels: int
    """Number of distinct values."""
    bits: float
    """log₂ of the number of steps in its span, i.e. the resolution of an instrument with that
    span.
    """
    share: float
    """Standard deviation of the rounding error, step/√12, relative to that of the series."""


def quantisation(values: FloatArray) -> Quantisation | None:
    """The step of the grid that contains all values; None without a grid or for a constant."""
    known = values[np.isfinite(values)]
    levels = np.unique(known)
    deviation = float(np.std(known)) if len(levels) > 1 else 0.0
    if deviation == 0:  # the least numbers have no squares
        return None
    span = float(levels[-1] - levels[0])
    steps = np.diff(levels)
    # conversions of units put equal values apart by a rounding
    steps = steps[steps > _ROUNDING * span]
    # each step as a multiple of the smallest: rounded values lie on a grid
    multiples = np.rint(steps / np.min(steps))
    total = float(np.sum(multiples))
    if total > 1 / _ROUNDING:
        return None
    # by the whole span: the error of the smallest step would add up
    step = span / total
    places = (levels - levels[0]) / step
    # one in a hundred may be off: interpolated by whoever recorded
    if np.mean(np.abs(places - np.rint(places)) <= _OFF_GRID) < 0.99:
        return None
    return Quantisation(
        step=step,
        levels=len(steps) + 1,
        bits=math.log2(total + 1),
        share=step / math.sqrt(12) / deviation,
    )


def rounding(values: FloatArray) -> float | None:
    """The quantisation step of a measured series; None for a switched or held one.

    Such a series is a command, whose values are exact even with few digits.
    """
    found = quantisation(values)
    if found is None or found.levels <= FEW_LEVELS:
        return None
    # a command is held for several rows: most differences are 0
    known = values[np.isfinite(values)]
    return None if np.median(np.abs(np.diff(known))) == 0 else found.step


@dataclass(frozen=True, slots=True, kw_only=True)
class SeriesCheck:
    """The properties of one series; NaN if it has no values."""

    rows: int
    """Number of rows, without those removed by a filter."""
    missing: int
    first_missing: int
    longest_missing: int
    mean: float
    deviation: float
    low: float
    high: float
    spikes: Spikes
    saturations: tuple[Saturation, ...]
    quantisation: Quantisation | None


def check_series(
    values: FloatArray, follows: BoolArray, lacks: BoolArray, left_out: int = 0
) -> SeriesCheck:
    """All properties of one series; `follows` is the mask of rows that continue the previous one.

    `lacks` is the mask of missing values; `left_out` rows are not counted.
    """
    known = values[np.isfinite(values)]
    return SeriesCheck(
        rows=len(values) - left_out,
        missing=int(lacks.sum()),
        first_missing=int(np.argmax(lacks)) if lacks.any() else 0,
        longest_missing=_longest(lacks),
        mean=float(np.mean(known)) if len(known) else np.nan,
        deviation=float(np.std(known)) if len(known) else np.nan,
        low=float(np.min(known)) if len(known) else np.nan,
        high=float(np.max(known)) if len(known) else np.nan,
        spikes=spikes(values, follows),
        saturations=saturation(values, follows),
        quantisation=quantisation(values),
    )


def _longest(wanted: BoolArray) -> int:
    """The maximum number of consecutive True values."""
    # edges of runs of True: begins and ends alternate
    edges = np.flatnonzero(np.diff(np.concatenate(([False], wanted, [False])).astype(np.int8)))
    return int(np.max(edges[1::2] - edges[::2], initial=0))


@dataclass(frozen=True, slots=True)
class Doubt:
    """A rule: values of a signal from `low` to `high` in `unit` are suspicious.

    The values are more plausible in the unit `rather`.
    """

    unit: str
    low: float
    high: float
    rather: str
    reason: str

    def holds(self, unit: Unit, low: float, high: float) -> bool:
        """True if all values of a signal, low … high, are in this range."""
        return unit.same_as(parse_unit(self.unit)) and self.low <= low and high <= self.high


DOUBTS = (
    # unit, low, high, rather, reason
    Doubt("K", -60.0, 150.0, "degC", "is below −120 °C"),
    Doubt("degC", 250.0, 450.0, "K", "is hotter than 250 °C all the time"),
    Doubt("Pa", 0.05, 50.0, "bar", "is a vacuum"),
    Doubt("bar", 5e4, 5e6, "Pa", "is more than 50000 bar"),
)
"""Suspicious ranges [low, high]; the reason states what the values would mean."""

_SIX_TURNS = 12 * math.pi


def doubt(unit: Unit | None, low: float, high: float) -> tuple[str, str] | None:
    """The more plausible unit of values from `low` to `high`, and the reason; None if plausible."""
    if unit is None or low == high:
        return None
    # the largest magnitude: angles may go either way
    largest = max(-low, high)
    if unit.text == "rad" and _SIX_TURNS < largest <= 360.0:
        return "deg", "is more than six turns"
    for row in DOUBTS:
        if row.holds(unit, low, high):
            return row.rather, row.reason
    return None

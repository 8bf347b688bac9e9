"""Reads data sets as docs/language.md defines it, in plain Python, row by row: the expected
result.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from benchmarks.fuzz.data_files import Clock, Table, Values

STEP = 0.1
"""The sample time, in seconds."""
NAMES = "uzy"
"""u is an input, z an input that an output predicts, y a target."""
SPLITS = (
    "{by: fraction, val: 0.3}",
    "{by: time, val: [0.5 s, 1.2 s]}",
    "{by: block, blocks: 4, val: [2], test: [4]}",
    "{by: kfold, k: 3, fold: 2}",
    "{by: file, val: 0.4}",
)


@dataclass
class Rows:
    """The expected rows of one recording."""

    time: Values
    columns: dict[str, Values]
    usable: np.ndarray
    continues: np.ndarray
    z_measured: np.ndarray
    sets: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    zero: float = 0.0
    """Seconds from the time 0 of dates in the spec to that of the recording."""


def reference(
    tables: Sequence[Table], keys: dict[str, str], clock: Clock
) -> tuple[list[Rows], set[str]]:
    """The expected recordings of the tables, or the codes of the expected errors."""
    every = int(keys.get("every", 1))
    gap = keys.get("gap")
    resamples = keys.get("resample") in ("linear", "nearest")
    single = [_without_duplicates([table], keys.get("duplicates"))[0][0] for table in tables]
    order = list(range(len(tables)))
    groups = _chains(single, every, resamples, gap) if keys.get("join") else [[i] for i in order]
    chains = [[tables[i] for i in group] for group in groups]
    recordings: list[Rows] = []
    codes: set[str] = set()
    for raw in chains:
        chain, numbers = _without_duplicates(raw, keys.get("duplicates"))
        whole = {name: np.concatenate([table[name] for table in chain]) for name in chain[0]}
        begin = float(whole["t"][0])
        zero = begin if clock.has_dated_keys else 0.0
        if clock.is_date:  # seconds from the first row
            whole["t"] = whole["t"] - begin
        first, stop = _bounds(whole["t"], numbers, keys, zero)
        if first >= stop:
            codes.add("E0818")
            continue
        part = {name: values[first:stop:every] for name, values in whole.items()}
        found = _resampled(part, keys) if resamples else _as_recorded(part, keys, codes)
        recording = _kept(found, keys, codes)
        if recording is not None:
            recording.zero = zero
            recordings.append(recording)
    longest = max([len(recordings), *(len(one.time) for one in recordings)])
    if "kfold" in keys.get("split", "") and not codes and longest < 3:
        codes.add("E0819")
    if "file" in keys.get("split", "") and not codes and len(recordings) == 1:
        codes.add("E0819")
    for index, one in enumerate(recordings):
        one.sets = _sets(one.time + one.zero, index, len(recordings), keys.get("split"))
    return recordings, codes


def _chains(
    tables: Sequence[Table], every: int, resamples: bool, gap: str | None
) -> list[list[int]]:
    """Groups files that follow each other in time, each with the earliest successor."""
    next_of: dict[int, int] = {}
    for i, table in enumerate(tables):
        following = [
            (other["t"][0], j)
            for j, other in enumerate(tables)
            if j != i
            and j not in next_of.values()
            and _follows(other["t"][0] - table["t"][-1], table["t"], every, resamples, gap)
        ]
        if following:
            next_of[i] = min(following)[1]
    chains: list[list[int]] = []
    for i in (i for i in range(len(tables)) if i not in next_of.values()):
        chain = [i]
        while chain[-1] in next_of:
            chain.append(next_of[chain[-1]])
        chains.append(chain)
    return chains


def _follows(step: float, moments: Values, every: int, resamples: bool, gap: str | None) -> bool:
    if resamples:
        return 0 < step <= _longest_step(moments, gap)
    return abs(step - STEP / every) <= 0.01 * STEP


def _usual(moments: Values) -> float:
    return float(np.median(np.diff(moments))) if len(moments) > 1 else 0.0


def _longest_step(moments: Values, gap: str | None) -> float:
    """The longest regular step of time; a longer one is a gap."""
    if gap is not None and gap.endswith("s"):
        return max(float(gap[:-1]), 1.5 * _usual(moments)) * (1 + 1e-6)
    return float(gap or 2.5) * max(STEP, _usual(moments)) * (1 + 1e-6)


def _without_duplicates(tables: Sequence[Table], how: str | None) -> tuple[list[Table], list[int]]:
    """The tables with one row per time, and the number of each row with all rows counted."""
    found: list[Table] = []
    numbers: list[int] = []
    begin = 0
    for table in tables:
        groups: list[list[int]] = []
        for row, moment in enumerate(table["t"]):
            if groups and table["t"][groups[-1][0]] == moment:
                groups[-1].append(row)
            else:
                groups.append([row])
        kept = [group[-1 if how == "last" else 0] for group in groups]
        reduced = {name: values[kept] for name, values in table.items()}
        for name in NAMES if how == "mean" else ():
            known = [[v for v in table[name][group] if v == v] for group in groups]
            reduced[name] = np.array([math.fsum(v) / len(v) if v else math.nan for v in known])
        found.append(reduced)
        numbers += [begin + row for row in kept]
        begin += len(table["t"])
    return found, numbers


def _bounds(
    moments: Values, numbers: list[int], keys: dict[str, str], zero: float
) -> tuple[int, int]:
    """The first and last row between `from` and `to`; their seconds count from `zero`."""
    first, stop = 0, len(moments)
    for key, text in keys.items():
        if key not in ("from", "to"):
            continue
        if not text.endswith("s"):
            if key == "from":
                first = sum(number < int(text) for number in numbers)
            else:
                stop = sum(number <= int(text) for number in numbers)
            continue
        seconds = float(text[:-1]) - zero
        slack = 1e-6 * max(abs(seconds), 1)
        if key == "from":
            first = int((moments < seconds - slack).sum())
        else:
            stop = int((moments <= seconds + slack).sum())
    return first, stop


@dataclass
class _Found:
    """A recording before missing values and `filter:` are applied."""

    rows: Rows
    covered: np.ndarray
    lost_rows: dict[str, np.ndarray]
    """Rows that want an input's value that was lost."""
    lost_times: dict[str, list[float]]


def _as_recorded(part: Table, keys: dict[str, str], codes: set[str]) -> _Found:
    moments, count = part["t"], len(part["t"])
    steps = np.diff(moments)
    good = np.abs(steps - STEP) <= 0.01 * STEP
    if keys.get("resample", "error") == "error":
        if (steps <= 0).any():
            codes.add("E0813")
        elif not good.all():
            codes.add("E0811" if abs(np.median(steps) - STEP) <= 0.01 * STEP else "E0812")
    columns = {name: part[name].copy() for name in NAMES}
    rows = Rows(
        moments, columns, np.ones(count, bool), np.append(False, good), np.ones(count, bool)
    )
    missing = {name: np.isnan(part[name]) for name in "uz"}
    times = {name: list(moments[absent]) for name, absent in missing.items()}
    return _Found(rows, np.ones(count, bool), missing, times)


def _resampled(part: Table, keys: dict[str, str]) -> _Found:
    moments, how = part["t"], keys["resample"]
    known = {name: (moments[~np.isnan(v)], v[~np.isnan(v)]) for name, v in part.items()}
    grid = _grid(moments, known)
    count = len(grid)
    covered = np.ones(count, bool)
    columns: dict[str, Values] = {}
    lost_rows = {name: np.zeros(count, bool) for name in "uz"}
    lost_times: dict[str, list[float]] = {name: list(moments) for name in "uz"}
    for name in "uz":
        at, values = known[name]
        if not len(at):
            covered[:], lost_rows[name][:], columns[name] = False, True, np.full(count, np.nan)
            continue
        columns[name] = np.array([_value(x, at, values, how) for x in grid])
        lost_times[name] = _lost_times(part, name, at)
        holes = np.diff(at) > _longest_step(at, keys.get("gap"))
        wanting = [any(a < x < b for x in lost_times[name]) for a, b in pairwise(at)]
        for row, moment in enumerate(grid):
            lost_rows[name][row] = _is_within(moment, at, wanting)
            covered[row] &= not (lost_rows[name][row] or _is_within(moment, at, holes))
    at, values = known["y"]
    columns["y"] = np.full(count, np.nan)
    for row in np.flatnonzero(_measured(grid, at) & covered):
        after = int(np.searchsorted(at, grid[row]))
        is_close = 0 < after < len(at) and at[after] - at[after - 1] <= 1.5 * STEP * (1 + 1e-6)
        way = "linear" if how == "linear" and is_close else "nearest"
        columns["y"][row] = _value(grid[row], at, values, way)
    continues = np.arange(count) > 0
    rows = Rows(grid, columns, np.ones(count, bool), continues, _measured(grid, known["z"][0]))
    return _Found(rows, covered, lost_rows, lost_times)


def _grid(moments: Values, known: dict[str, tuple[Values, Values]]) -> Values:
    """The expected times after resampling, from the first sample of u.

    z may be extrapolated by half a sample time at both ends.
    """
    u, z = (known[name][0] if len(known[name][0]) else moments for name in "uz")
    late = max(z[0], moments[0])
    low = u[0] + STEP * max(0, math.ceil((late - u[0]) / STEP - 0.5 - 1e-6))
    high = min(u[-1], z[-1] + 0.5 * STEP, moments[-1] + 0.5 * STEP)
    return low + STEP * np.arange(
        math.floor((high - low) / STEP + 0.01 + 1e-6) + 1 if high >= low else 0
    )


def _lost_times(part: Table, name: str, at: Values) -> list[float]:
    """Times of empty cells in which a column usually has a value."""
    moments = part["t"]
    longest = max(STEP, 1.5 * _usual(at)) * (1 + 1e-6)
    lost: list[float] = []
    for moment in moments[np.isnan(part[name])]:
        before, after = at[at < moment], at[at > moment]
        low = before[-1] if len(before) else moments[0]
        high = after[0] if len(after) else moments[-1]
        if high - low > longest:
            lost.append(float(moment))
    return lost


def _is_within(moment: float, at: Values, bad: Sequence[bool] | np.ndarray) -> bool:
    """True if a time is within an invalid step, with a margin of 1 % of the sample time."""
    slack = 0.01 * STEP
    return any(b and at[i] + slack < moment < at[i + 1] - slack for i, b in enumerate(bad))


def _value(moment: float, at: Values, values: Values, how: str) -> float:
    if how == "linear":
        return float(np.interp(moment, at, values))
    return values[min(range(len(at)), key=lambda i: (round(abs(at[i] - moment), 12), at[i]))]


def _measured(grid: Values, at: Values) -> np.ndarray:
    """The rows of the grid to which a value belongs: the nearest within half a sample time.

    Of two equally near rows it is the earlier one.
    """
    found = np.zeros(len(grid), bool)
    for moment in at if len(grid) else ():
        off = np.abs(grid - moment)
        row = min(range(len(grid)), key=lambda k: (round(off[k], 9), k))
        found[row] |= off[row] <= 0.5 * STEP * (1 + 1e-6)
    return found


def _kept(found: _Found, keys: dict[str, str], codes: set[str]) -> Rows | None:
    """The recording after `filter:` and `nan:`; None if it is omitted or an error."""
    rows, covered, nan = found.rows, found.covered, keys.get("nan", "error")
    count = len(rows.time)
    keep, is_known_out = np.ones(count, bool), np.zeros(count, bool)
    if "filter" in keys:
        limit = float(keys["filter"].strip('"').split(">")[1])
        in_hole = ~covered & ~found.lost_rows["u"] & ~found.lost_rows["z"]
        u = np.where(found.lost_rows["u"] | in_hole, np.nan, rows.columns["u"])
        keep = np.nan_to_num(u, nan=-np.inf) > limit
        is_known_out = ~keep & ~np.isnan(u)
    is_missing = any(
        not count or moment < rows.time[0] - 1e-9 or moment > rows.time[-1] + 1e-9
        for name in "uz"
        for moment in found.lost_times[name]
    ) or any((lost & ~is_known_out).any() for lost in found.lost_rows.values())
    if not count and (not is_missing or nan == "split"):
        codes.add("E0818")
        return None
    if is_missing and nan != "split":
        codes.update({"E0809"} if nan == "error" else set())
        return None
    known = ~np.isnan(rows.columns["u"]) & ~np.isnan(rows.columns["z"])
    rows.usable = covered & known & keep
    return rows


def _sets(moments: Values, index: int, recordings: int, split: str | None) -> np.ndarray:
    """The expected set of each row: 0 for train, 1 for val, 2 for test."""
    count = len(moments)
    sets = np.zeros(count, int)

    def cut(share: float) -> int:
        return math.floor(share * count + 0.5)

    match None if split is None else SPLITS.index(split):
        case 0:
            sets[cut(0.7) :] = 1
        case 1:
            slack = 1e-6 * np.maximum(np.abs(moments), 1)
            sets[(moments >= 0.5 - slack) & (moments < 1.2 - slack)] = 1
        case 2:
            sets[cut(1 / 4) : cut(2 / 4)], sets[cut(3 / 4) :] = 1, 2
        case 3 if recordings >= 3:
            sets[:] = index * 3 // recordings == 1
        case 3:
            sets[cut(1 / 3) : cut(2 / 3)] = 1
        case 4:
            # shares of 0.6 and 0.4: the set that is furthest behind its share comes next
            sets[:] = index % 5 in (1, 3)
        case _:
            pass
    return sets

"""Divides recordings into the sets train, val and test: by file, block, fraction, time or fold."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msnn.data.dataset import UNASSIGNED, FloatArray
from msnn.data.reading.rows import TimeBound, bound_of_seconds, time_bound
from msnn.errors.data import rows as errors
from msnn.errors.data.files import set_without_rows
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.expressions.moments import Moment
from spec_schema.sections.data import (
    SETS,
    Blocks,
    DateRange,
    Fraction,
    OneShare,
    Split,
    TimeRange,
)

SetCodes = NDArray[np.int8]


def split_source(sources: Sequence[str], split: Split, findings: Findings) -> str | None:
    """The source that a split divides: `train`, or the only source."""
    if "train" in sources:
        return "train"
    if len(sources) == 1:
        return sources[0]
    reason = "`split` divides the source `train` or a lone one, and there is neither"
    findings.report(errors.impossible_split(reason, split.place.key))
    return None


@dataclass(frozen=True, slots=True)
class RecordTimes:
    """The number of rows of a recording and their times, for splits."""

    rows: int
    time: FloatArray | None
    """Time of each row in seconds; None without a time column and a sample time."""
    begins: Moment | None = None
    """Time 0, if times are dates."""
    file: str = ""
    """Name in messages."""


def split_rows(
    split: Split, records: Sequence[RecordTimes], codes: Mapping[str, int], findings: Findings
) -> list[SetCodes]:
    """The set index of every row of every recording.

    Reports a requested set that gets no rows, and a time range that is partly outside the data.
    """
    found = _rows_of_sets(split, records, codes, findings)
    for name, share in _shares(split).items():
        is_wanted = not isinstance(share, Fraction) or share.value > 0
        if not is_wanted or findings.failed:
            continue
        covered = _covered(split, records)
        if not any((c == codes[name]).any() for c in found):
            findings.report(set_without_rows(name, covered, share.span))
        elif isinstance(share, TimeRange | DateRange) and covered is not None:
            before, after = _seconds_outside(share, records)
            if before or after:
                findings.report(
                    set_without_rows(name, covered, share.span, before=before, after=after)
                )
    return found


def _shares(split: Split) -> dict[str, OneShare]:
    """The shares in the spec, by set."""
    shares = {"train": split.train, "val": split.val, "test": split.test}
    return {name: share for name, share in shares.items() if share is not None}


def _covered(split: Split, records: Sequence[RecordTimes]) -> str | None:
    """The time range of the data as text, for a split by time; else None."""
    ends = [(float(t[0]), float(t[-1])) for r in records if (t := r.time) is not None and len(t)]
    if split.by != "time" or not ends:
        return None
    dated = [
        (r.begins.text_after(float(t[0])), r.begins.text_after(float(t[-1])))
        for r in records
        if (t := r.time) is not None and len(t) and r.begins is not None
    ]
    # dates with and without a time zone cannot be ordered
    if len(dated) == len(ends) and len({first.endswith("Z") for first, _ in dated}) == 1:
        return f"{min(a for a, _ in dated)} to {max(b for _, b in dated)}"
    return f"{min(a for a, _ in ends):.6g} s to {max(b for _, b in ends):.6g} s"


def _seconds_outside(
    share: TimeRange | DateRange, records: Sequence[RecordTimes]
) -> tuple[float, float]:
    """Seconds by which a range begins before the first row and ends after the last; 0 within a
    step.
    """
    before: list[float] = []
    after: list[float] = []
    for record in records:
        bounds = _bounds(share, record, "", Findings())
        if record.time is None or not len(record.time) or bounds is None:
            continue
        step = float(np.median(np.diff(record.time))) if len(record.time) > 1 else 0.0
        start, stop = bounds
        first, last = float(record.time[0]) - start.seconds, stop.seconds - float(record.time[-1])
        before.append(first if first > step + start.slack else 0.0)
        after.append(last if last > step + stop.slack else 0.0)
    return min(before, default=0.0), min(after, default=0.0)


def _rows_of_sets(
    split: Split, records: Sequence[RecordTimes], codes: Mapping[str, int], findings: Findings
) -> list[SetCodes]:
    match split.by:
        case "file":
            chosen = _files(_fractions(split), len(records))
            for name, share in _fractions(split).items():
                if share > 0 and chosen and name not in chosen:
                    reason = (
                        f"{len(records)} files are too few to give `{name}` {share:.0%} of them"
                    )
                    findings.report(errors.impossible_split(reason, split.place.key))
            return [
                np.full(record.rows, codes.get(name, UNASSIGNED), dtype=np.int8)
                for name, record in zip(chosen, records, strict=True)
            ]
        case "fraction":
            # of each record: every one has a part in all sets
            return [_fraction_rows(_fractions(split), record.rows, codes) for record in records]
        case "block":
            return [_block_rows(split, record.rows, codes) for record in records]
        case "time":
            return [_time_rows(split, record, codes, findings) for record in records]
        case "kfold":
            return _fold_rows(split, records, codes, findings)


def _time_rows(
    split: Split, record: RecordTimes, codes: Mapping[str, int], findings: Findings
) -> SetCodes:
    """Set index of rows by time; rows in no range belong to `train` unless its range is given."""
    rest = UNASSIGNED if split.train is not None else codes["train"]
    # `val` and `test` are written over `train` where ranges touch
    rows = np.full(record.rows, rest, dtype=np.int8)
    if record.time is None:
        findings.report(errors.no_time_column("`by: time`", split.place.key))
        return rows
    for name, share in _shares(split).items():
        if isinstance(share, TimeRange | DateRange):
            bounds = _bounds(share, record, f"`split: {name}`", findings)
            if bounds is None:
                return rows
            start, stop = (bound.seconds - bound.slack for bound in bounds)
            rows[(record.time >= start) & (record.time < stop)] = codes[name]
    return rows


def _bounds(
    share: TimeRange | DateRange, record: RecordTimes, what: str, findings: Findings
) -> tuple[TimeBound, TimeBound] | None:
    """The bounds of a range on a recording's clock; None after reporting invalid dates."""
    if isinstance(share, TimeRange):
        return bound_of_seconds(share.start), bound_of_seconds(share.stop)
    start = time_bound(what, share.start, record.begins, record.file, findings)
    stop = time_bound(what, share.stop, record.begins, record.file, findings)
    return None if start is None or stop is None else (start, stop)


def _fold_rows(
    split: Split, records: Sequence[RecordTimes], codes: Mapping[str, int], findings: Findings
) -> list[SetCodes]:
    assert split.k is not None, "the schema asks for `k:`"
    count, fold = split.k, split.fold - 1
    # whole records are folds where there are enough, else each record is cut into all of them
    most = max(len(records), max((record.rows for record in records), default=0))
    if count > most:
        reason = f"{count} folds are more than rows or records: some would hold out nothing"
        findings.report(
            errors.impossible_split(reason, split.place.key, f"write `k: {most}` or less")
        )
    found: list[SetCodes] = []
    for index, record in enumerate(records):
        rows = np.full(record.rows, codes["train"], dtype=np.int8)
        if len(records) >= count:
            # whole records where there are enough: neighbours in time would tell a fold its answers
            # records in their order in runs alike long: fold i has those with ⌊index · k / n⌋ = i
            held_out = slice(None) if index * count // len(records) == fold else slice(0)
        else:
            start = _rounded(fold * record.rows / count)
            held_out = slice(start, _rounded((fold + 1) * record.rows / count))
        rows[held_out] = codes["val"]
        found.append(rows)
    return found


def _fractions(split: Split) -> dict[str, float]:
    """The share of each set; the remainder belongs to `train` unless its share is given."""
    given = {"train": split.train, "val": split.val, "test": split.test}
    shares = {name: s.value if isinstance(s, Fraction) else 0.0 for name, s in given.items()}
    if split.train is None:
        shares["train"] = max(1.0 - shares["val"] - shares["test"], 0.0)
    return shares


def _files(shares: Mapping[str, float], count: int) -> list[str]:
    """A set for each file, spread evenly over the order of the files; deterministic."""
    # what belongs to no set takes its turn like a set
    shares = {**shares, "": max(1.0 - sum(shares.values()), 0.0)}
    owed = dict.fromkeys(shares, 0.0)
    chosen: list[str] = []
    for _ in range(count):
        for name, share in shares.items():
            owed[name] += share
        # like the allotment of seats: each file goes to the set that is furthest behind its share,
        # so that sets are spread over the order of the files without chance
        most = max(owed, key=lambda name: owed[name])
        owed[most] -= 1.0
        chosen.append(most)
    return chosen


def _fraction_rows(shares: Mapping[str, float], length: int, codes: Mapping[str, int]) -> SetCodes:
    rows = np.full(length, UNASSIGNED, dtype=np.int8)
    passed = 0.0
    for name in SETS:
        start, passed = passed, passed + shares[name]
        # from summed shares, so that sets leave no row between them
        rows[_rounded(start * length) : _rounded(passed * length)] = codes[name]
    return rows


def _block_rows(split: Split, length: int, codes: Mapping[str, int]) -> SetCodes:
    rows = np.full(length, UNASSIGNED, dtype=np.int8)
    assert split.blocks is not None, "the schema asks for `blocks:`"
    for name, numbers in _blocks(split, split.blocks).items():
        for number in numbers:
            start = _rounded((number - 1) * length / split.blocks)
            rows[start : _rounded(number * length / split.blocks)] = codes[name]
    return rows


def _blocks(split: Split, count: int) -> dict[str, tuple[int, ...]]:
    """The blocks of each set; the remaining ones belong to `train` unless its blocks are given."""
    given = {"train": split.train, "val": split.val, "test": split.test}
    named = {name: s.numbers if isinstance(s, Blocks) else () for name, s in given.items()}
    if split.train is None:
        taken = {*named["val"], *named["test"]}
        named["train"] = tuple(n for n in range(1, count + 1) if n not in taken)
    return named


def _rounded(value: float) -> int:
    # Python's `round` takes halves to even numbers: blocks of alike length would differ by two rows
    return math.floor(value + 0.5)

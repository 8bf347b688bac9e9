"""Converts times of day in a zone with summer time to UTC, exactly, by the order of rows."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

import numpy as np

from msnn.data.dataset import BoolArray, FloatArray, IntArray
from spec_schema.expressions.moments import Moment
from spec_schema.late_dataclass import dataclass

if TYPE_CHECKING:
    from zoneinfo import ZoneInfo

_BLOCK = 900
"""Seconds within which clocks usually are not changed; blocks that differ are read per second."""
_NANO = 1_000_000_000
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass(frozen=True, slots=True)
class UtcTimes:
    """Times in UTC, and the rows whose times do not determine a moment."""

    seconds: FloatArray
    """Seconds since the first row."""
    begins: Moment
    skipped: IntArray
    """Rows with a time that the clock skips at the beginning of summer time."""
    doubtful: IntArray
    """Rows with a time that the clock shows twice, where the order of rows does not tell which."""


def utc_times(seconds: FloatArray, begins: Moment, zone: str) -> UtcTimes:
    """The times in UTC of a clock in a zone.

    `seconds` since the date `begins`, (rows,), are those that the clock showed. Offsets are those
    of `zoneinfo`, by PEP 495: fold 0 is the earlier of two times that look equal. Of successive
    rows with such times, those before the only step back are the earlier ones and the others the
    later ones; without a step back, or with several, they are doubtful.
    """
    local = begins.nanoseconds + np.round(seconds * _NANO).astype(np.int64)
    early, late = _offsets(local // _NANO, _zone(zone))
    skipped = np.flatnonzero(early < late)
    is_twice = early > late
    offsets = np.where(is_twice, early, late)
    doubtful: list[IntArray] = []
    edges = np.flatnonzero(np.diff(np.concatenate(([0], is_twice.astype(np.int8), [0]))))
    for start, stop in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        back = np.flatnonzero(np.diff(local[start:stop]) < 0)
        if len(back) == 1:
            after = start + int(back[0]) + 1
            offsets[after:stop] = late[after:stop]
        else:
            doubtful.append(np.arange(start, stop, dtype=np.int64))
    utc = local - offsets * _NANO
    first = int(utc[0])
    none = np.zeros(0, np.int64)
    return UtcTimes(
        (utc - first) / _NANO, Moment(first, True), skipped, np.concatenate((none, *doubtful))
    )


def _offsets(seconds: IntArray, zone: ZoneInfo) -> tuple[IntArray, IntArray]:
    """Offsets from UTC in seconds of local times, for fold 0 and fold 1."""
    blocks, block_of_row = np.unique(seconds // _BLOCK, return_inverse=True)
    begins = [_offset_pair(block * _BLOCK, zone) for block in blocks.tolist()]
    ends = [_offset_pair(block * _BLOCK + _BLOCK - 1, zone) for block in blocks.tolist()]
    pairs = np.array(begins, np.int64)[block_of_row]
    changes = np.array([a != b for a, b in zip(begins, ends, strict=True)], np.bool_)
    rows: BoolArray = changes[block_of_row]
    for row in np.flatnonzero(rows).tolist():
        pairs[row] = _offset_pair(int(seconds[row]), zone)
    return pairs[:, 0], pairs[:, 1]


def fixed_zone(begins: Moment, seconds: float, zone: str) -> str | None:
    """The name of the zone without summer time; None if its offset is not one of whole hours."""
    pair = _offset_pair(begins.nanoseconds // _NANO + round(seconds), _zone(zone))
    hours, rest = divmod(min(pair), 3600)
    if rest or not -12 <= hours <= 14:
        return None
    # the sign of these names is that of POSIX: hours behind Greenwich count as positive
    return f"Etc/GMT{-hours:+d}" if hours else "UTC"


def _zone(name: str) -> ZoneInfo:
    # loads in milliseconds, and few specs have zones
    from zoneinfo import ZoneInfo

    return ZoneInfo(name)


def _offset_pair(seconds: int, zone: ZoneInfo) -> tuple[int, int]:
    clock = (_EPOCH + timedelta(seconds=seconds)).replace(tzinfo=zone)
    found = (clock.replace(fold=fold).utcoffset() or timedelta(0) for fold in (0, 1))
    one, other = (round(offset.total_seconds()) for offset in found)
    return one, other

"""Divides series into intervals without gaps, and reduces the number of rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from msnn.data.dataset import BoolArray, FloatArray

_MOST_ROWS = 200_000
"""Maximum number of analysed rows; more rows only take more time."""
_BLOCK = 10_000


@dataclass(frozen=True, slots=True)
class Piece:
    """Consecutive rows: one series to explain, and explaining inputs (rows, inputs)."""

    output: FloatArray
    inputs: FloatArray

    def __len__(self) -> int:
        return len(self.output)


def pieces_of(output: FloatArray, inputs: FloatArray, follows: BoolArray) -> list[Piece]:
    """The maximal intervals of consecutive rows without missing values.

    Means are subtracted. With more than 200,000 rows, evenly spread blocks are used.
    """
    known = np.isfinite(output) & np.isfinite(inputs).all(axis=1)
    before = np.concatenate(([False], known[:-1]))
    # a piece begins where a row lacks a value or follows no other
    starts = np.flatnonzero(known & ~(before & follows))
    after = np.concatenate((known[1:] & follows[1:], [False]))
    stops = np.flatnonzero(known & ~after) + 1
    total = int(known.sum())
    if not total:
        return []
    # means over all pieces: those of each would take slow motion away
    level, levels = float(np.mean(output[known])), np.mean(inputs[known], axis=0)
    # every so many blocks, spread over the whole record
    every = -(-total // _MOST_ROWS)
    found: list[Piece] = []
    number = 0
    for start, stop in zip(starts.tolist(), stops.tolist(), strict=True):
        for first in range(start, stop, _BLOCK) if every > 1 else (start,):
            last = min(first + _BLOCK, stop) if every > 1 else stop
            if number % every == 0:
                found.append(Piece(output[first:last] - level, inputs[first:last] - levels))
            number += 1
    return found


def slower(pieces: Sequence[Piece], factor: int) -> list[Piece]:
    """Means of `factor` neighbouring rows, as an anti-aliasing filter."""
    if factor == 1:
        return list(pieces)
    found: list[Piece] = []
    for piece in pieces:
        count = len(piece) // factor
        if count:
            output = piece.output[: count * factor].reshape(count, factor).mean(axis=1)
            inputs = piece.inputs[: count * factor].reshape(count, factor, -1).mean(axis=1)
            found.append(Piece(output, inputs))
    return found


def rows_of(pieces: Sequence[Piece]) -> int:
    """The number of all rows."""
    return sum(map(len, pieces))

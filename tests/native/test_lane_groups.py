"""Groups of lanes against a plain loop: batches, lengths, what pads the last group."""

from __future__ import annotations

import numpy as np
import pytest

from backends.native.kernel_data import group_type, lane_groups

TYPE = group_type(8, np.dtype("float64"))


def by_hand(starts: list[int], steps: list[int]) -> list[tuple[int, list[int], list[int]]]:
    """Groups of one batch: each length for itself, the longest first."""
    groups = []
    for length in sorted(set(steps), reverse=True):
        members = [start for start, own in zip(starts, steps, strict=True) if own == length]
        for begin in range(0, len(members), 8):
            part = members[begin : begin + 8]
            missing = 8 - len(part)
            used = [-1] * len(part) + [0] * missing
            groups.append((length, part + part[-1:] * missing, used))
    return groups


@pytest.mark.parametrize(
    ("sizes", "lengths"),
    [
        *[([16, 8, 24], 1), ([16, 8, 13], 1), ([1, 30, 9], 1), ([40, 3], 3), ([7], 2)],
        *[([16], 1), ([13], 1), ([3], 1)],  # equal lengths in one batch: of all rows of the data
    ],
)
def test_groups_of_batches(sizes: list[int], lengths: int) -> None:
    random = np.random.default_rng(3)
    starts = random.integers(0, 1000, sum(sizes))
    steps = random.integers(5, 5 + lengths, sum(sizes))
    groups, bounds = lane_groups(TYPE, starts, steps, sizes)
    end = 0
    for number, size in enumerate(sizes):
        begin, end = end, end + size
        expected = by_hand(starts[begin:end].tolist(), steps[begin:end].tolist())
        found = groups[bounds[number] : bounds[number + 1]]
        assert [(g["steps"], g["start"].tolist(), g["used"].tolist()) for g in found] == expected
    assert bounds.dtype == np.int64  # what the kernel reads
    assert len(groups) == bounds[-1]

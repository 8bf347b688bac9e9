"""Arranges rollouts in the lanes of a kernel: groups of equal length, padded at the end."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Rows = NDArray[np.int64]
Groups = NDArray[Any]
"""An array of `struct group`."""

LANES = {"float32": 16, "float64": 8}
"""Rollouts per group: GROUP in the prelude of the kernels."""


def group_type(lanes: int, dtype: np.dtype[Any]) -> np.dtype[Any]:
    """`struct group` of the kernels: steps, start rows, and a mask of used lanes."""
    # mask elements have the size of the reals
    truth = np.int32 if dtype.itemsize == 4 else np.int64
    fields = [("steps", np.int64), ("start", np.int64, (lanes,)), ("used", truth, (lanes,))]
    return np.dtype(fields, align=True)


def lane_groups(
    type: np.dtype[Any], starts: Rows, steps: Rows, sizes: Sequence[int]
) -> tuple[Groups, Rows]:
    """Groups of batches of `sizes` rollouts, and the bounds of each batch among the groups.

    Rollout i starts at row `starts[i]` and has `steps[i]` steps; within a batch the longest come
    first. Unused lanes repeat the last rollout of their group and are marked as unused.
    """
    lanes = type["start"].shape[0]
    batch = np.repeat(np.arange(len(sizes)), sizes)
    # the last key is the primary one: by batch, then by descending length
    order = np.lexsort((-steps, batch))
    batch, sorted_steps = batch[order], steps[order]
    new = (np.diff(batch) != 0) | (np.diff(sorted_steps) != 0)
    begins = np.concatenate([[0], np.flatnonzero(new) + 1])
    members = np.diff([*begins, len(order)])
    count = -(-members // lanes)
    # for each lane: its index among the lanes of its length and batch
    within = np.arange(count.sum() * lanes) - np.repeat(
        np.cumsum(count * lanes) - count * lanes, count * lanes
    )
    members_there, begins_there = (np.repeat(x, count * lanes) for x in (members, begins))
    chosen = order[begins_there + np.minimum(within, members_there - 1)].reshape(-1, lanes)
    groups = np.zeros(len(chosen), type)
    groups["steps"] = steps[chosen[:, 0]]
    groups["start"] = starts[chosen]
    # −1 has all bits set, like the result of a vector comparison
    groups["used"] = -(within < members_there).reshape(-1, lanes).astype(int)
    ends = np.cumsum(np.bincount(np.repeat(batch[begins], count), minlength=len(sizes)))
    return groups, np.concatenate([[0], ends])

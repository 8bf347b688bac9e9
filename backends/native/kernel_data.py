"""Arranges logs and rollouts in the memory of a kernel: ctypes structs, arrays, groups of lanes."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.files.disk_arrays import blocks, laid_out
from backends.native.kernel_source import KernelSource

FloatArray = NDArray[np.float64]


class KernelData:
    """The data of rollouts as the kernel reads them. `series` are (rows, *shape) by name of signal.
    The first `skip` steps of a rollout do not count in losses. `scored` are masks (rows,) by name
    of loss; None means that all rows count. `problem` is the C struct; it points into arrays that
    this object keeps alive. `missing` is True if the count of scored elements depends on the rows.
    """

    def __init__(
        self,
        source: KernelSource,
        dtype: np.dtype[Any],
        series: Mapping[str, FloatArray],
        skip: int,
        scored: Mapping[str, NDArray[np.bool_]] | None,
    ) -> None:
        self._names = source.signals
        self._series = [laid_out(series[name], dtype) for name in self._names]
        self._scored: list[NDArray[np.uint8]] = []
        gaps = any(bool(np.isnan(part).any()) for s in self._series for part in blocks(s))
        self.missing = scored is not None or source.has_factors or gaps
        table = None
        if scored is not None:
            self._scored = [np.ascontiguousarray(scored[name], np.uint8) for name in source.losses]
            table = pointers(self._scored)
        self._tables = (pointers(self._series), table)
        rows = len(self._series[0]) if self._series else 0
        self.problem = ProblemStruct(
            ctypes.cast(self._tables[0], ctypes.c_void_p),
            rows,
            None if table is None else ctypes.cast(table, ctypes.c_void_p),
            skip,
        )

    def write(self, series: Mapping[str, FloatArray]) -> None:
        """Overwrites series (rows, *shape) by name in place, in the arrays that the kernel reads.
        Names that the kernel does not read are ignored. An array may be shared with the caller who
        gave it, and then changes for the caller too.
        """
        for name, values in series.items():
            if name in self._names:
                self._series[self._names.index(name)][...] = values


_ALIGNMENT = 64
"""Size in bytes of the widest vector."""


class ProblemStruct(ctypes.Structure):
    """The C struct `problem` of templates/native/driver.c: series, number of rows, masks of scored
    rows, number of first steps that do not count in losses.
    """

    # ctypes uses the platform's ABI: order and widths must agree with the C code
    _fields_ = (
        ("series", ctypes.c_void_p),
        ("rows", ctypes.c_int64),
        ("scored", ctypes.c_void_p),
        ("skip", ctypes.c_int64),
    )


class VariablesStruct(ctypes.Structure):
    """The C struct `variables` of templates/native/variables.c: addresses of raw and physical
    values, bounds, scales, learning rates and the optimiser's moments, one element per variable.
    """

    _fields_ = tuple(
        (name, ctypes.c_void_p)
        for name in ("kind", "low", "high", "scale", "rate", "raw", "physical", "first", "second")
    )


class KnownStruct(ctypes.Structure):
    """The C struct `known` of templates/native/known.c: addresses of the priors of parameters, and
    of the penalties on magnitudes and on norms of slices.
    """

    _fields_ = (
        ("mean", ctypes.c_void_p),
        ("std", ctypes.c_void_p),
        ("magnitude", ctypes.c_void_p),
        ("numbers", ctypes.c_void_p),
        ("bounds", ctypes.c_void_p),
        ("norms", ctypes.c_void_p),
        ("slices", ctypes.c_int64),
        ("spread", ctypes.c_double),
    )


class CurvatureStruct(ctypes.Structure):
    """The C struct `curvature` of templates/native/lbfgs.c, the memory of L-BFGS: its latest pairs
    of a step and the change of the gradient along it.
    """

    _fields_ = (
        ("history", ctypes.c_int32),
        ("iterations", ctypes.c_int32),
        ("looks", ctypes.c_int32),
        ("pairs", ctypes.c_int32),
        ("newest", ctypes.c_int32),
        ("steps", ctypes.c_void_p),
        ("changes", ctypes.c_void_p),
        ("shares", ctypes.c_void_p),
        ("along", ctypes.c_void_p),
        ("work", ctypes.c_void_p),
    )


class OptimizerStruct(ctypes.Structure):
    """The C struct `optimizer` of templates/native/optimizers.c: method, constants and step
    counts.
    """

    _fields_ = (
        ("method", ctypes.c_int32),
        ("missing", ctypes.c_int32),
        ("beta1", ctypes.c_double),
        ("beta2", ctypes.c_double),
        ("epsilon", ctypes.c_double),
        ("decay", ctypes.c_double),
        ("clip", ctypes.c_double),
        ("steps", ctypes.c_int64),
        ("first_decay", ctypes.c_double),
        ("second_decay", ctypes.c_double),
        ("left_out", ctypes.c_int64),
        ("known", ctypes.POINTER(KnownStruct)),
        ("curvature", ctypes.POINTER(CurvatureStruct)),
    )


class WorkStruct(ctypes.Structure):
    """The C struct `work` of templates/native/batches.c: working memory of a call, number of
    threads, rank of this process.
    """

    _fields_ = (
        ("memory", ctypes.c_void_p),
        ("steps", ctypes.c_int64),
        ("groups", ctypes.c_int64),
        ("kept", ctypes.c_int32),
        ("threads", ctypes.c_int32),
        ("rank", ctypes.c_int32),
        ("ranks", ctypes.c_int32),
        ("hand_on", ctypes.c_void_p),
    )


def pointer(array: NDArray[Any]) -> ctypes.c_void_p:
    """The address of the first element, as an argument of a C function. The caller must keep the
    array alive while C uses it.
    """
    return ctypes.c_void_p(array.ctypes.data)


def pointers(arrays: Sequence[NDArray[Any]]) -> ctypes.Array[ctypes.c_void_p]:
    """A C array of the addresses of the arrays' first elements. The caller must keep the arrays
    alive.
    """
    # at least one: C has no empty arrays
    return (ctypes.c_void_p * max(len(arrays), 1))(*(array.ctypes.data for array in arrays))


def aligned(size: int) -> NDArray[np.uint8]:
    """An array of `size` bytes, all 0, whose address is a multiple of 64 as vector instructions
    need.
    """
    raw = np.zeros(size + _ALIGNMENT, np.uint8)
    # numpy aligns to 16 bytes only: vector loads would fault or be slow
    offset = -raw.ctypes.data % _ALIGNMENT
    # the view keeps the whole array alive
    return raw[offset : offset + size]


Rows = NDArray[np.int64]
Groups = NDArray[Any]
"""An array of `struct group`."""

LANES = {"float32": 16, "float64": 8}
"""Rollouts per group: GROUP in the prelude of the kernels."""


def group_type(lanes: int, dtype: np.dtype[Any]) -> np.dtype[Any]:
    """`struct group` of the kernels as a numpy dtype: number of steps, start row of each lane, and
    a mask of used lanes (-1 used, 0 unused). `dtype` is that of the kernel's reals.
    """
    # mask elements have the size of the reals
    truth = np.int32 if dtype.itemsize == 4 else np.int64
    fields = [("steps", np.int64), ("start", np.int64, (lanes,)), ("used", truth, (lanes,))]
    return np.dtype(fields, align=True)


def lane_groups(
    type: np.dtype[Any], starts: Rows, steps: Rows, sizes: Sequence[int]
) -> tuple[Groups, Rows]:
    """Splits rollouts into lane groups of equal length; returns the groups and `bounds`. The first
    `sizes[0]` rollouts are batch 0, and so on; batch i is groups[bounds[i]:bounds[i+1]]. Rollout k
    starts at row `starts[k]` and has `steps[k]` steps; within a batch the longest come first.
    Unused lanes repeat the last rollout of their group and are marked as unused. `type` is that of
    `group_type`.
    """
    lanes = type["start"].shape[0]
    if len(sizes) == 1 and (steps == steps[:1]).all():
        return _equal_groups(type, starts, int(steps[0]))
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


def _equal_groups(type: np.dtype[Any], starts: Rows, steps: int) -> tuple[Groups, Rows]:
    """The lane groups of one batch of rollouts that begin at the rows `starts` and all have `steps`
    steps, in their order, and the bounds [0, number of groups]. There may be as many rollouts as
    rows of the data, so no other array is made.
    """
    lanes = type["start"].shape[0]
    groups = np.zeros(-(-len(starts) // lanes), type)
    whole = len(starts) // lanes
    groups["steps"] = steps
    groups["start"][:whole] = starts[: whole * lanes].reshape(-1, lanes)
    # −1 has all bits set, like the result of a vector comparison
    groups["used"] = -1
    if whole < len(groups):
        rest = starts[whole * lanes :]
        groups["start"][whole] = rest[-1]
        groups["start"][whole, : len(rest)] = rest
        groups["used"][whole, len(rest) :] = 0
    return groups, np.array([0, len(groups)], np.int64)

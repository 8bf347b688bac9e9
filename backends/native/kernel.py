"""Runs a training kernel: losses and gradients of rollouts, whole epochs of batches."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from backends.c_language.literals import Dtype
from backends.known_terms import KnownTerms
from backends.native.compile_kernel import compiled_kernel
from backends.native.handed_sums import HandedSums, Ranks
from backends.native.kept_sources import kept_source
from backends.native.kernel_data import KernelData
from backends.native.kernel_source import KernelSource, kernel_source, losses_source
from backends.native.kernel_structs import (
    WorkStruct,
    aligned,
    pointer,
)
from backends.native.lanes.lane_groups import LANES, Groups, Rows, group_type, lane_groups
from backends.native.variables import Rule, Variables
from compiler.differentiation.training_step import TrainingStep, losses_alone, training_step
from compiler.ir.program import Program

FloatArray = NDArray[np.float64]

KEPT_BYTES = 32 << 20
"""A thread keeps all rows of a rollout up to here; beyond it computes a segment at a time again."""


@dataclass(frozen=True, slots=True)
class Losses:
    """Σ and count of every loss, and ∂(weighted total)/∂ physical parameters, flat."""

    sums: FloatArray
    counts: FloatArray
    gradient: FloatArray


@kept_source
def _source(program: Program, dtype: Dtype, *, reproducible: bool, lbfgs: bool) -> KernelSource:
    return kernel_source(training_step(program), dtype, reproducible=reproducible, lbfgs=lbfgs)


@kept_source
def _source_of_losses(program: Program, dtype: Dtype) -> KernelSource:
    return losses_source(losses_alone(program), dtype)


class Kernel:
    """One program, its loops closed, compiled for this machine. Raises CompilerMissingError.

    Without `slopes` it has the losses alone: what runs backwards is most of what is compiled. It
    steps by `lbfgs` or by the other optimisers.
    """

    def __init__(
        self,
        program: Program,
        dtype: Dtype,
        threads: int = 1,
        kept_bytes: int = KEPT_BYTES,
        *,
        reproducible: bool = False,
        slopes: bool = True,
        lbfgs: bool = False,
    ) -> None:
        self._threads = threads
        self._kept_bytes = kept_bytes
        self._memory = np.zeros(0, np.uint8)
        self._reserved, self._reservation = (0, 0), WorkStruct()
        self.slopes = slopes
        self.source = (
            _source(program, dtype, reproducible=reproducible, lbfgs=lbfgs)
            if slopes
            else _source_of_losses(program, dtype)
        )
        self.program = program
        self.dtype = np.dtype(dtype)
        self.lanes = LANES[dtype]
        self.group_type = group_type(self.lanes, self.dtype)
        built = compiled_kernel(self.source.text, on_lanes=True)
        self.built = built
        self._library = built.library
        # ctypes expects an int, which sizes from 2 GiB on do not fit
        self._library.msnn_work_bytes.restype = ctypes.c_int64
        if slopes:
            self._library.msnn_train.restype = ctypes.c_int64

    @property
    def step(self) -> TrainingStep:
        """The compiled training step, as the interpreter runs it."""
        return training_step(self.program) if self.slopes else losses_alone(self.program)

    def groups(self, starts: Rows, steps: Rows | int) -> Groups:
        """Lane groups of rollouts that begin at rows `starts`; each group has one length."""
        return self.batches(starts, steps, len(starts))[0]

    def batches(
        self, starts: Rows, steps: Rows | int, size: int, members: Rows | None = None
    ) -> tuple[Groups, Rows]:
        """Groups of batches of `size` one after the other, and the bounds that `train` takes.

        `steps` is one number where all rollouts are as long. `members` says which rollouts the
        batches are made of and in which order; by default all as they stand.
        """
        if members is None:
            members = np.arange(len(starts), dtype=np.int64)
        count = len(members)
        if not isinstance(steps, int) and (steps == steps[0]).all():
            steps = int(steps[0])
        # groups have one length: where rollouts differ they are sorted into groups in Python
        if not isinstance(steps, int):
            sizes = [min(size, count - begin) for begin in range(0, count, size)]
            return lane_groups(self.group_type, starts[members], steps[members], sizes)
        whole, rest = divmod(count, size)
        # rounded up: no group has rollouts of two batches
        a_batch, in_rest = -(-size // self.lanes), -(-rest // self.lanes)
        groups = np.empty(whole * a_batch + in_rest, self.group_type)
        starts, members = (np.ascontiguousarray(rows, np.int64) for rows in (starts, members))
        self._library.msnn_groups(
            pointer(starts),
            pointer(members),
            ctypes.c_int64(count),
            ctypes.c_int64(size),
            ctypes.c_int64(steps),
            pointer(groups),
        )
        bounds = np.arange(whole + 1 + (rest > 0), dtype=np.int64) * a_batch
        # the last batch may be shorter
        bounds[-1] = len(groups)
        return groups, bounds

    def shuffled(self, count: int, key: int) -> Rows:
        """The numbers 0 … count−1 in the order that a key of 64 bits decides."""
        order = np.empty(count, np.int64)
        self._library.msnn_shuffled(ctypes.c_uint64(key), ctypes.c_int64(count), pointer(order))
        return order

    def data(
        self,
        series: Mapping[str, FloatArray],
        skip: int = 0,
        scored: Mapping[str, NDArray[np.bool_]] | None = None,
    ) -> KernelData:
        """The logs as the kernel reads them."""
        return KernelData(self.source, self.dtype, series, skip, scored)

    def _work(self, groups: Groups, largest: int) -> WorkStruct:
        """Memory for a call whose batches have at most so many groups; later calls use it again."""
        steps = int(groups["steps"].max())
        # calls of a training are alike: the C is asked for the size once
        if (steps, largest) == self._reserved:
            return self._reservation
        # what one thread needs to keep all rows of its rollouts
        alone = WorkStruct(None, steps, 0, 1, 1, 0, 1)
        kept = self._library.msnn_work_bytes(ctypes.byref(alone)) <= self._kept_bytes
        threads = min(self._threads, max(largest, 1))
        struct = WorkStruct(None, steps, largest, int(kept), threads, 0, 1)
        size = self._library.msnn_work_bytes(ctypes.byref(struct))
        if size > len(self._memory):
            self._memory = aligned(size)
        struct.memory = self._memory.ctypes.data
        self._reserved, self._reservation = (steps, largest), struct
        return struct

    def losses(
        self,
        data: KernelData,
        groups: Groups,
        physical: FloatArray,
        weights: Sequence[float],
        *,
        gradient: bool = True,
        ranks: Ranks | None = None,
    ) -> Losses:
        """Losses of the groups, and the gradient of their weighted total if it is wanted.

        With `ranks` each does a part and all get the whole, to the bits of one process.
        """
        count = len(self.source.losses)
        sums, counts = np.zeros(count), np.zeros(count)
        slope = np.zeros(len(physical), self.dtype)
        work = self._work(groups, len(groups))
        handed = _handed(work, ranks)
        # names of their own: ctypes keeps addresses, and nobody else would keep the arrays
        theta = np.asarray(physical, self.dtype)
        scale = np.asarray(weights, float)
        self._library.msnn_losses(
            ctypes.byref(data.problem),
            pointer(groups),
            ctypes.c_int64(len(groups)),
            pointer(theta),
            pointer(scale),
            ctypes.c_int(data.missing),
            ctypes.byref(work),
            pointer(slope) if gradient else None,
            pointer(sums),
            pointer(counts),
        )
        # what ranks have raised waits until here: C has no exceptions
        if handed is not None:
            handed.raise_failure()
        return Losses(sums, counts, slope.astype(float))

    def train(
        self,
        data: KernelData,
        groups: Groups,
        bounds: Rows,
        variables: Variables,
        weights: Sequence[float],
        before: tuple[FloatArray, FloatArray] | None = None,
        *,
        ranks: Ranks | None = None,
    ) -> tuple[int, FloatArray, FloatArray]:
        """Batches `groups[bounds[i]:bounds[i+1]]` in order, an optimiser step after each.

        With `ranks` each does a part of every batch, and all take the same step.
        Returns how many batches were finite (all, unless one stopped it), and sums and counts of
        their losses, added one batch after the other to those `before`: the bits do not depend on
        where an epoch is divided into calls.
        """
        # the C adds to them in place; without `before` one array of zeros is copied twice
        sums, counts = (one.copy() for one in before or (np.zeros(len(self.source.losses)),) * 2)
        work = self._work(groups, int((bounds[1:] - bounds[:-1]).max()))
        handed = _handed(work, ranks)
        scale = np.asarray(weights, float)
        variables.optimizer.missing = int(data.missing)
        done = self._library.msnn_train(
            ctypes.byref(data.problem),
            pointer(groups),
            pointer(bounds),
            ctypes.c_int64(len(bounds) - 1),
            ctypes.byref(variables.addresses),
            ctypes.byref(variables.optimizer),
            pointer(scale),
            ctypes.byref(work),
            pointer(sums),
            pointer(counts),
        )
        if handed is not None:
            handed.raise_failure()
        return int(done), sums, counts

    def variables(
        self,
        rule: Rule,
        weights: Mapping[str, FloatArray],
        rates: Mapping[str, float],
        known: KnownTerms | None = None,
    ) -> Variables:
        """The variables at these weights; those with a rate that were on a bound begin off it."""
        made = Variables(
            program=self.program,
            dtype=self.dtype,
            rule=rule,
            weights=weights,
            rates=rates,
            known=known,
        )
        assert made.known is None or self.source.takes_known, "compiled without what is known"
        self.fill_in_physical(made)
        return made

    def fill_in_physical(self, variables: Variables) -> None:
        """Fills in the physical values of the raw variables that move."""
        self._library.msnn_physical(ctypes.byref(variables.addresses))
        variables.keep_given()


def _handed(work: WorkStruct, ranks: Ranks | None) -> HandedSums | None:
    """Tells a call which rank it is of; what is returned must outlive the call."""
    if ranks is None:
        work.rank, work.ranks, work.hand_on = 0, 1, None
        return None
    handed = HandedSums(ranks)
    work.rank, work.ranks, work.hand_on = ranks.rank, ranks.count, handed.address
    return handed

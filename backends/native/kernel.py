"""Runs a training kernel: losses and gradients of rollouts, and epochs of batches."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from backends.c_language.literals import Dtype
from backends.known_terms import KnownTerms
from backends.native.compile_kernel import compiled_kernel
from backends.native.kernel_data import (
    LANES,
    Groups,
    KernelData,
    Rows,
    WorkStruct,
    aligned,
    group_type,
    lane_groups,
    pointer,
)
from backends.native.kernel_source import KernelSource, kept_source, kernel_source, losses_source
from backends.native.variables import Rule, Variables
from compiler.differentiation.training_step import TrainingStep, losses_alone, training_step
from compiler.ir.program import Program

FloatArray = NDArray[np.float64]

KEPT_BYTES = 32 << 20
"""Maximum memory per thread for all rows of a rollout; beyond it segments are recomputed."""


@dataclass(frozen=True, slots=True)
class Losses:
    """The losses of some rollouts: for each loss the sum of its cost over scored elements and their
    count, both (losses,). `gradient` is ∂(weighted total)/∂(physical parameters), flat; 0 if not
    requested.
    """

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
    """A training kernel: a program with closed loops, compiled for this machine. It uses up to
    `threads` threads. Each stores a whole rollout for the reverse loop in at most `kept_bytes`
    bytes; of a longer one it recomputes parts. A `reproducible` kernel gives the same bits on
    processors without fused multiplication and addition. Without `slopes` it computes losses only,
    which compiles much faster. With `lbfgs` it contains only that optimiser, otherwise the others.
    Raises CompilerMissingError and KernelBuildError.
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
        # ctypes assumes int, which is too small for 2 GiB
        self._library.msnn_work_bytes.restype = ctypes.c_int64
        if slopes:
            self._library.msnn_train.restype = ctypes.c_int64

    @property
    def step(self) -> TrainingStep:
        """The graphs of the training step that the kernel implements, to compare it with the
        interpreter.
        """
        return training_step(self.program) if self.slopes else losses_alone(self.program)

    def groups(self, starts: Rows, steps: Rows | int) -> Groups:
        """Lane groups of rollouts of `steps` steps (one number, or one for each) from the rows
        `starts`. All rollouts of a group have the same length.
        """
        return self.batches(starts, steps, len(starts))[0]

    def batches(
        self, starts: Rows, steps: Rows | int, size: int, members: Rows | None = None
    ) -> tuple[Groups, Rows]:
        """Splits rollouts into batches of `size` and these into lane groups. Returns all groups,
        and `bounds`: batch i is groups[bounds[i]:bounds[i+1]]. Rollout k begins at row `starts[k]`
        and has `steps` or `steps[k]` steps. `members` lists the rollouts in the order of the
        batches; by default all of them in order.
        """
        if members is None:
            members = np.arange(len(starts), dtype=np.int64)
        count = len(members)
        if not isinstance(steps, int) and (steps == steps[0]).all():
            steps = int(steps[0])
        # rollouts of different lengths are sorted into groups in Python
        if not isinstance(steps, int):
            sizes = [min(size, count - begin) for begin in range(0, count, size)]
            return lane_groups(self.group_type, starts[members], steps[members], sizes)
        whole, rest = divmod(count, size)
        # rounded up: a group never spans two batches
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
        """A random permutation of 0 … count−1 that the 64-bit integer `key` determines."""
        order = np.empty(count, np.int64)
        self._library.msnn_shuffled(ctypes.c_uint64(key), ctypes.c_int64(count), pointer(order))
        return order

    def data(
        self,
        series: Mapping[str, FloatArray],
        skip: int = 0,
        scored: Mapping[str, NDArray[np.bool_]] | None = None,
    ) -> KernelData:
        """The series (rows, *shape) by name of signal in the memory layout of the kernel. The first
        `skip` steps of a rollout do not count in losses. `scored` are masks (rows,) by name of
        loss: True where the row counts; by default all rows.
        """
        return KernelData(self.source, self.dtype, series, skip, scored)

    def _work(self, groups: Groups, largest: int) -> WorkStruct:
        """The working memory of a call whose batches have at most `largest` groups. The memory is
        kept and used again by later calls.
        """
        steps = int(groups["steps"].max())
        # calls of a training are similar: the size is computed once
        if (steps, largest) == self._reserved:
            return self._reservation
        # the memory of one thread for all rows of its rollouts
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
        """The losses of the rollouts in `groups` on `data`, and if requested the gradient of Σ
        weight·loss. `physical` are the physical parameters, flat; `weights` has one number per
        loss. With `ranks`, each process computes a part and all get the total, with the same bits
        as in a single process. Raises the exceptions of `ranks`.
        """
        count = len(self.source.losses)
        sums, counts = np.zeros(count), np.zeros(count)
        slope = np.zeros(len(physical), self.dtype)
        work = self._work(groups, len(groups))
        handed = _handed(work, ranks)
        # local names keep the arrays alive: ctypes stores only addresses
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
        # exceptions of ranks are raised here, as C has none
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
        """Runs batches `groups[bounds[i]:bounds[i+1]]` in order, and after each an optimiser step,
        which changes `variables`. `weights` has one number per loss. With `ranks`, each process
        computes a part of every batch, and all take the same step; their exceptions are raised
        here.

        Returns the number of batches done (all, unless a non-finite one stopped it), and the sums
        and counts of their losses. These are added batch by batch to `before`, so the bits do not
        depend on how an epoch is split into calls.
        """
        # the C code adds in place, so `before` is copied
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
        """The optimiser's variables, starting at these weights (physical arrays by name). `rates`
        are learning rates by parameter; one without a rate is fixed. `known` are priors and
        penalties. A learned value on a bound is moved off it.
        """
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
        """Computes the physical values from the raw variables, in place. Variables that have not
        changed keep the exact values that they began with.
        """
        self._library.msnn_physical(ctypes.byref(variables.addresses))
        variables.keep_given()


def _handed(work: WorkStruct, ranks: Ranks | None) -> HandedSums | None:
    """Writes rank and number of processes into the working memory of a call. Returns the callback
    that exchanges sums, None for a single process; it must live until the call has ended.
    """
    if ranks is None:
        work.rank, work.ranks, work.hand_on = 0, 1, None
        return None
    handed = HandedSums(ranks)
    work.rank, work.ranks, work.hand_on = ranks.rank, ranks.count, handed.address
    return handed


Sums = NDArray[np.uint8]
"""Bytes of sums, which are replaced in place."""


class Ranks(Protocol):
    """The processes that share one training. A sum over all of them goes from rank to rank: each
    receives that of the ranks before it, adds its own, and hands it on.
    """

    @property
    def rank(self) -> int:
        """The index of this process, from 0."""
        ...

    @property
    def count(self) -> int:
        """The number of processes."""
        ...

    def receive(self, sums: Sums) -> None:
        """Waits for the sums of the previous rank and writes them over `sums`, in place; the first
        rank keeps its own.
        """
        ...

    def hand_on(self, sums: Sums) -> None:
        """Sends `sums` to the next rank and then replaces them, in place, by those of the last
        rank, which are the total.
        """
        ...


class HandedSums:
    """A C callback by which a running kernel exchanges sums with other ranks. An exception of
    `ranks` ends the kernel early and is kept until `raise_failure`.
    """

    def __init__(self, ranks: Ranks) -> None:
        self._ranks = ranks
        self._failure: BaseException | None = None
        # a reference keeps the callback alive while C can call it
        self._function = _FUNCTION(self._called)
        self.address = ctypes.cast(self._function, ctypes.c_void_p).value

    def raise_failure(self) -> None:
        """Raises the exception that ended the kernel early; does nothing if there is none."""
        if self._failure is not None:
            failure, self._failure = self._failure, None
            raise failure

    def _called(self, whole: int, address: int, size: int) -> int:
        if self._failure is not None:  # a line search may call again before it ends
            return 0
        sums = np.ctypeslib.as_array((ctypes.c_uint8 * size).from_address(address))
        try:
            if whole:
                self._ranks.hand_on(sums)
            else:
                self._ranks.receive(sums)
        except BaseException as failure:  # noqa: BLE001  (C has no exceptions: it is raised later)
            self._failure = failure
            return 0
        return 1


def added_by(ranks: Ranks, own: NDArray[Any]) -> NDArray[Any]:
    """The sum of the arrays `own` of all ranks, added in the order of ranks, so that each rank gets
    the same bits.
    """
    found = np.zeros_like(own)
    ranks.receive(found.reshape(-1).view(np.uint8))
    found += own
    ranks.hand_on(found.reshape(-1).view(np.uint8))
    return found


_FUNCTION = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_int32, ctypes.c_void_p, ctypes.c_int64)

"""Writes and runs a kernel of sensitivities: products of residuals and their Jacobian."""

from __future__ import annotations

import ctypes
import re
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from backends.c_language.functions import FunctionNames
from backends.c_language.places import ArrayView, Index
from backends.gauss_newton_products import (
    Products,
    ProductsOfRuns,
    StartBlocks,
    one_after_the_other,
)
from backends.native.kernel_data import Groups, KernelData, Rows, group_type, lane_groups, pointer
from backends.native.kernel_functions import ModelFunctions, Stored
from backends.native.kernel_source import (
    PREFIX,
    KernelSource,
    LaneFunctions,
    forward_arrays,
    kept_source,
    rendered,
    whole_source,
)
from backends.native.lane_functions import array
from backends.native.lane_memory import LaneMemory
from backends.native.rollout_kernel import DTYPE, WIDTH, LaneLibrary
from compiler.differentiation.sensitivities import Sensitivities
from compiler.differentiation.training_step import forward_only
from compiler.ir.program import NodeId

_BLOCK = 4
"""The length of rows is a multiple of it; BLOCK of templates/native/sensitivities.c.j2."""

ROWS = "rows"


@dataclass(frozen=True, slots=True)
class SensitivitySource:
    """The source of a sensitivity kernel. `width` is the length of a row: derivatives of a
    residual, the residual, and a mark that is 1 where the residual is excluded; padded. `marked` is
    False if no residual can be excluded, so that rows have no mark.
    """

    source: KernelSource
    width: int
    marked: bool


@kept_source
def sensitivity_source(found: Sensitivities) -> SensitivitySource:
    """The source of a float64 kernel that sums products of residuals and their Jacobian over
    rollouts.
    """
    memory = LaneMemory(forward_only(found.program, found.losses))
    functions = LaneFunctions(FunctionNames(PREFIX, "float64", "own"))
    marked = any(one.left_out is not None for one in found.residuals)
    # derivatives, residual, mark; padded to whole blocks
    width = -(-(found.numbers + 1 + marked) // _BLOCK) * _BLOCK
    firsts, places = _rows(found, width)
    writer = ModelFunctions(memory, functions, Stored(ROWS, places))
    made = {"start": writer.start(), "ahead": writer.ahead(), "step": writer.step()}
    loops = rendered(
        "sensitivities.c.j2",
        made,
        **forward_arrays(memory),
        learned=found.numbers,
        width=width,
        residuals=firsts[-1],
        first_rows=firsts,
    )
    source = whole_source(memory, "float64", functions, made, (), (loops,))
    return SensitivitySource(source, width, marked)


def _rows(
    found: Sensitivities, width: int
) -> tuple[list[int], tuple[tuple[NodeId, ArrayView], ...]]:
    """First the index of the first row of every loss, and the number of all rows; a loss that is no
    sum of squares has no rows. Then the nodes of residuals, derivatives and marks, each with its
    place in the array of rows, which are `width` long.
    """
    firsts = [0]
    places: list[tuple[NodeId, ArrayView]] = []
    residuals = {residual.loss.name: residual for residual in found.residuals}
    for loss in found.program.losses:
        residual = residuals.get(loss.name)
        if residual is None:
            # a loss that is not a sum of squares has no rows
            firsts.append(firsts[-1])
            continue
        type = found.program.step[residual.values].type
        each = array(ROWS, type.shape)
        strides = tuple(stride * width for stride in each.strides)
        first = firsts[-1] * width
        values = ArrayView(each.storage, type.shape, strides, Index(first + found.numbers))
        # the learned parameters are the innermost axis: products run along rows
        slopes = ArrayView(each.storage, (found.numbers, *type.shape), (1, *strides), Index(first))
        places += [(residual.values, values), (residual.slopes, slopes)]
        if residual.left_out is not None:
            mark = ArrayView(each.storage, type.shape, strides, Index(first + found.numbers + 1))
            places.append((residual.left_out, mark))
        firsts.append(firsts[-1] + type.size)
    return firsts, tuple(places)


FloatArray = NDArray[np.float64]

STACK = 4 * 2**20
"""Maximum bytes of derivatives on any stack: half of a usual thread stack, as compilers spill."""

_APART = 64 * 2**20
"""Maximum bytes for products that one call sums separately per rollout."""

LARGEST_STACK = 64 * 2**20
"""Maximum bytes of derivatives on a stack of a dedicated thread."""


class StackTooSmallError(Exception):
    """The derivatives of one step need more stack than `LARGEST_STACK` bytes. The message has the
    size.
    """


class SensitivityKernel(LaneLibrary):
    """A compiled kernel for sensitivities of a program. Raises StackTooSmallError,
    CompilerMissingError and KernelBuildError.
    """

    def __init__(self, found: Sensitivities) -> None:
        made = sensitivity_source(found)
        # checked before compiling
        self._stack = _stack(made.source.text, WIDTH * DTYPE.itemsize)
        if self._stack > LARGEST_STACK:
            raise StackTooSmallError(f"a step needs {self._stack / 2**20:.1f} MiB of stack")
        super().__init__(made.source)
        self.numbers = found.numbers
        self._width, self._marked = made.width, made.marked
        self._groups = group_type(WIDTH, DTYPE)
        self._library.msnn_products.restype = None

    def products(
        self, data: KernelData, starts: Rows, steps: Rows, physical: FloatArray
    ) -> dict[str, Products]:
        """By name of loss: products of its residuals r and their Jacobian J (JᵀJ, Jᵀr, rᵀr), summed
        over rollouts of `steps[i]` steps from rows `starts[i]` of `data`. `physical` are the
        physical parameters, flat.
        """
        groups, _ = lane_groups(self._groups, starts, steps, [len(starts)])
        summed = self._summed(data, groups, physical, apart=False)
        numbers, whole = self.numbers, _whole(summed.products, self.numbers)
        return {
            name: Products(
                curvature=whole[i, :numbers, :numbers],
                slope=whole[i, numbers, :numbers],
                squares=float(whole[i, numbers, numbers]),
                cost=float(summed.sums[i]),
                count=float(summed.counts[i]),
                left_out=float(summed.products[i, numbers + 1, numbers + 1]) if self._marked else 0,
            )
            for i, name in enumerate(self.source.losses)
        }

    def products_of_runs(
        self, data: KernelData, starts: Rows, steps: Rows, physical: FloatArray, own: int
    ) -> dict[str, ProductsOfRuns]:
        """By name of loss: products of its residuals and their Jacobian J, separately for each
        rollout and in the given order. Rollout i has `steps[i]` steps from row `starts[i]` of
        `data`; `physical` are the physical parameters, flat. The last `own` columns of J are
        unknowns of each rollout itself, such as initial states. Blocks of the other columns, the
        shared parameters, are summed.
        """
        # the groups first contain rollout indices, to restore the order afterwards
        groups, _ = lane_groups(self._groups, np.arange(len(starts)), steps, [len(starts)])
        parts: dict[str, list[ProductsOfRuns]] = {name: [] for name in self.source.losses}
        members: list[Rows] = []
        some = max(1, _APART // (len(parts) * self._width**2 * WIDTH * DTYPE.itemsize))
        for begin in range(0, len(groups), some):
            part = groups[begin : begin + some].copy()
            used = part["used"].ravel() != 0
            members.append(part["start"].ravel()[used])
            part["start"] = starts[part["start"]]
            summed = self._summed(data, part, physical, apart=True).of_runs(used)
            for i, name in enumerate(parts):
                parts[name].append(self._of_runs(summed, i, own))
        order = np.argsort(np.concatenate(members))
        return {n: one_after_the_other(found).in_order(order) for n, found in parts.items()}

    def _summed(
        self, data: KernelData, groups: Groups, physical: FloatArray, *, apart: bool
    ) -> _Summed:
        losses, width = len(self.source.losses), self._width
        before, lanes = ((len(groups),), (WIDTH,)) if apart else ((), ())
        sums, counts = np.zeros((2, *before, losses, *lanes))
        found = np.zeros((*before, losses, width, width, *lanes))
        work = self._work(int(groups["steps"].max()))
        theta = np.ascontiguousarray(physical, DTYPE)

        def add() -> None:
            self._library.msnn_products(
                ctypes.byref(data.problem),
                pointer(groups),
                ctypes.c_int64(len(groups)),
                ctypes.c_int64(apart),
                pointer(theta),
                pointer(work),
                pointer(sums),
                pointer(counts),
                pointer(found),
            )

        with_stack(self._stack, add)
        return _Summed(found, sums, counts)

    def _of_runs(self, summed: _Summed, loss: int, own: int) -> ProductsOfRuns:
        """The products of the loss with index `loss`, from separate sums per rollout. The last
        `own` columns belong to each rollout itself.
        """
        n, end = self.numbers - own, self.numbers
        found = _whole(summed.products[:, loss], end)
        marks = summed.products[:, loss, end + 1, end + 1] if self._marked else np.zeros(1)
        squares, cost, count = found[:, end, end], summed.sums[:, loss], summed.counts[:, loss]
        blocks = StartBlocks(found[:, :n, n:end], found[:, n:end, n:end], found[:, end, n:end])
        shared = Products(
            curvature=found[:, :n, :n].sum(axis=0),
            slope=found[:, end, :n].sum(axis=0),
            squares=float(squares.sum()),
            cost=float(cost.sum()),
            count=float(count.sum()),
            left_out=float(marks.sum()),
            starts=blocks,
        )
        return ProductsOfRuns(shared, squares, cost, count)


@dataclass(frozen=True, slots=True)
class _Summed:
    """For each loss: products of rows (losses, width, width), sum of its cost and count of scored
    elements, both (losses,). Sums that are kept apart have a first axis of groups and a last axis
    of lanes; `of_runs` replaces both by a first axis of rollouts.
    """

    products: FloatArray
    sums: FloatArray
    counts: FloatArray

    def of_runs(self, used: NDArray[np.bool_]) -> _Summed:
        """Sums with a first axis of rollouts, from sums per group and lane. `used` (groups ·
        lanes,) is False for lanes without a rollout.
        """

        def runs(values: FloatArray) -> FloatArray:
            last = np.moveaxis(values, -1, 1)
            return last.reshape(-1, *last.shape[2:])[used]

        return _Summed(runs(self.products), runs(self.sums), runs(self.counts))


def _whole(products: FloatArray, numbers: int) -> FloatArray:
    """The symmetric matrix [J r]ᵀ[J r] of size numbers + 1 (the last two axes), from its lower
    triangle in `products`. J has `numbers` columns; r is the residual.
    """
    lower = np.tril(products[..., : numbers + 1, : numbers + 1])
    return lower + np.swapaxes(np.tril(lower, -1), -1, -2)


def with_stack(needed: int, run: Callable[[], None]) -> None:
    """Calls `run`, which needs `needed` bytes of stack: directly if these are at most `STACK`,
    otherwise in a thread with twice that stack. Raises the exceptions of `run`. Unused stack takes
    no memory, as pages are allocated on first access.
    """
    if needed <= STACK:
        run()
        return
    # a process-wide setting for new threads: restored once this one has started
    with ThreadPoolExecutor(1) as alone:
        usual = threading.stack_size(2 * needed)
        try:
            done = alone.submit(run)
        finally:
            threading.stack_size(usual)
        # re-raises exceptions of the thread
        done.result()


def _stack(text: str, lanes: int) -> int:
    """The total size in bytes of the local arrays in the C source `text`, an upper limit of the
    stack that they need. `lanes` is the size of a vector in bytes.
    """
    return lanes * sum(map(int, re.findall(r"^ +lanes \w+\[(\d+)\];$", text, re.MULTILINE)))

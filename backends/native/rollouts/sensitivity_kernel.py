"""Runs a kernel that simulates sensitivities: products of residuals and slopes of rollouts."""

from __future__ import annotations

import ctypes
import re
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from backends.gauss_newton_products import Products
from backends.native.kernel_data import KernelData
from backends.native.kernel_structs import pointer
from backends.native.lanes.lane_groups import Rows, group_type, lane_groups
from backends.native.rollouts.lane_library import DTYPE, WIDTH, LaneLibrary
from backends.native.rollouts.sensitivity_source import sensitivity_source
from compiler.differentiation.sensitivities import Sensitivities

FloatArray = NDArray[np.float64]

STACK = 4 * 2**20
"""Bytes that slopes may take on any stack: half of what threads usually have: compilers spill."""

LARGEST_STACK = 64 * 2**20
"""Bytes that they may take on one of their own."""


class StackTooSmallError(Exception):
    """The slopes of one step need more stack than a thread is given."""


class SensitivityKernel(LaneLibrary):
    """One program with its sensitivities, compiled here.

    Raises CompilerMissingError and StackTooSmallError.
    """

    def __init__(self, found: Sensitivities) -> None:
        made = sensitivity_source(found)
        # before the compiler is called: what would not run need not be built
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
        """The products of each loss, summed over rollouts from rows `starts`."""
        groups, _ = lane_groups(self._groups, starts, steps, [len(starts)])
        losses, width, numbers = len(self.source.losses), self._width, self.numbers
        sums, counts = np.zeros(losses), np.zeros(losses)
        found = np.zeros((losses, width, width))
        work = self._work(int(steps.max()))
        theta = np.ascontiguousarray(physical, DTYPE)

        def add() -> None:
            self._library.msnn_products(
                ctypes.byref(data.problem),
                pointer(groups),
                ctypes.c_int64(len(groups)),
                pointer(theta),
                pointer(work),
                pointer(sums),
                pointer(counts),
                pointer(found),
            )

        with_stack(self._stack, add)
        # a mark is 0 or √ of the factor of its row, so that the sum of its squares counts
        marks = found[:, numbers + 1, numbers + 1] if self._marked else np.zeros(losses)
        # the kernel sums blocks up to the diagonal: what is above comes by symmetry
        lower = np.tril(found[:, : numbers + 1, : numbers + 1])
        whole = lower + np.tril(lower, -1).transpose(0, 2, 1)
        return {
            name: Products(
                curvature=whole[i, :numbers, :numbers],
                slope=whole[i, numbers, :numbers],
                squares=float(whole[i, numbers, numbers]),
                cost=float(sums[i]),
                count=float(counts[i]),
                left_out=float(marks[i]),
            )
            for i, name in enumerate(self.source.losses)
        }


def with_stack(needed: int, run: Callable[[], None]) -> None:
    """Runs it with twice as much stack as its arrays need: here, or in a thread that has so much.

    What a thread was not given it does not take: pages of a stack are there when they are touched.
    """
    if needed <= STACK:
        run()
        return
    # a setting of the process, for threads to come: taken back once this one has started
    with ThreadPoolExecutor(1) as alone:
        usual = threading.stack_size(2 * needed)
        try:
            done = alone.submit(run)
        finally:
            threading.stack_size(usual)
        # what it raises would end the thread alone, and leave sums of nothing
        done.result()


def _stack(text: str, lanes: int) -> int:
    """Bytes of the arrays of a step: a compiler that reuses none of them takes so many."""
    return lanes * sum(map(int, re.findall(r"^ +lanes \w+\[(\d+)\];$", text, re.MULTILINE)))

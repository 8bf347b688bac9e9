"""Writes and runs a kernel that stores outputs of rollouts and sums their losses, in float64."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from backends.c_language.functions import FunctionNames
from backends.c_language.places import ArrayView, Index
from backends.native.compile_kernel import compiled_kernel
from backends.native.kernel_data import (
    LANES,
    Groups,
    KernelData,
    Rows,
    aligned,
    group_type,
    pointer,
)
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
from compiler.differentiation.training_step import forward_only, loss_terms
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import NodeId, Program

DTYPE = np.dtype(np.float64)
WIDTH = LANES["float64"]
"""Rollouts per group."""


class LaneLibrary:
    """A compiled float64 kernel, with methods that arrange logs and working memory for it. Raises
    CompilerMissingError and KernelBuildError.
    """

    def __init__(self, source: KernelSource) -> None:
        self.source, self.dtype, self.lanes = source, DTYPE, WIDTH
        self.built = compiled_kernel(source.text, on_lanes=True)
        self._library = self.built.library
        # ctypes assumes int, but long rollouts need more than 2 GiB
        self._library.msnn_work_lanes.restype = ctypes.c_int64
        self._library.msnn_work_lanes.argtypes = [ctypes.c_int64]

    def data(
        self,
        series: Mapping[str, NDArray[np.float64]],
        skip: int = 0,
        scored: Mapping[str, NDArray[np.bool_]] | None = None,
    ) -> KernelData:
        """The series (rows, *shape) by name of signal in the kernel's layout. The first `skip`
        steps of a rollout do not count in losses. `scored` are masks (rows,) by name of loss; by
        default all rows count.
        """
        return KernelData(self.source, DTYPE, series, skip, scored)

    def _work(self, steps: int) -> NDArray[np.uint8]:
        """Working memory for one group of rollouts of at most `steps` steps."""
        return aligned(self._library.msnn_work_lanes(steps) * WIDTH * DTYPE.itemsize)


_STORED = "outputs"


@dataclass(frozen=True, slots=True)
class RolloutSource:
    """The source of a kernel that stores outputs. `width` is the number of elements of all outputs
    of a step.
    """

    source: KernelSource
    width: int


@kept_source
def rollout_source(program: Program) -> RolloutSource:
    """The source of a float64 kernel that computes outputs and losses of a program with closed
    loops.
    """
    builder = GraphBuilder(program.step)
    # appended to the step's graph, so that losses share nodes with the outputs
    losses = loss_terms(builder, program)
    memory = LaneMemory(forward_only(replace(program, step=builder.graph()), losses))
    functions = LaneFunctions(FunctionNames(PREFIX, "float64", "own"))
    places: list[tuple[NodeId, ArrayView]] = []
    width = 0
    for output in program.outputs:
        type = program.step[output.node].type
        places.append((output.node, array(_STORED, type.shape, Index(width))))
        # outputs of a step are consecutive, in the order of the program
        width += type.size
    writer = ModelFunctions(memory, functions, Stored(_STORED, tuple(places)))
    made = {"start": writer.start(), "ahead": writer.ahead(), "step": writer.step()}
    loops = rendered("rollouts.c.j2", made, **forward_arrays(memory), width=width)
    source = whole_source(memory, "float64", functions, made, (), (loops,))
    return RolloutSource(source, width)


FloatArray = NDArray[np.float64]

_AT_ONCE = 1 << 14
"""Steps per call: a multiple of SEGMENT of templates/native/rollouts.c.j2."""
_LANE_ROWS = np.dtype([("steps", np.int64, (WIDTH,)), ("row", np.int64, (WIDTH,))])


@dataclass(frozen=True, slots=True)
class Rolled:
    """The results of some rollouts. `outputs` (Σ steps, elements per step) has the rollouts one
    after the other, in the caller's order. `sums` and `counts` (losses,) are the cost of each loss
    over all scored elements, and their number.
    """

    outputs: FloatArray
    sums: FloatArray
    counts: FloatArray


class RolloutKernel(LaneLibrary):
    """A compiled kernel for outputs and losses of a program with closed loops, in float64. Raises
    CompilerMissingError and KernelBuildError.
    """

    def __init__(self, program: Program) -> None:
        made = rollout_source(program)
        super().__init__(made.source)
        self.program, self._width = program, made.width
        self._library.msnn_rollouts.restype = None

    def run(
        self,
        data: KernelData,
        starts: Rows,
        steps: Rows,
        physical: FloatArray,
        advance: Callable[[int], None],
    ) -> Rolled:
        """Runs rollouts of `steps[i]` steps from rows `starts[i]`. `physical` are the physical
        parameters, flat. `advance` is called with the number of rollout steps done since its last
        call, for progress.
        """
        losses = len(self.source.losses)
        found = Rolled(
            np.empty((int(steps.sum()), self._width)), np.zeros(losses), np.zeros(losses)
        )
        groups, rows = _groups(starts, steps)
        work = self._work(int(steps.max(initial=0)))
        theta = np.ascontiguousarray(physical, DTYPE)
        for first, stop, begin, end in _calls(groups["steps"]):
            self._library.msnn_rollouts(
                ctypes.byref(data.problem),
                pointer(groups[first:stop]),
                pointer(rows[first:stop]),
                ctypes.c_int64(stop - first),
                ctypes.c_int64(begin),
                ctypes.c_int64(end),
                pointer(theta),
                pointer(work),
                pointer(found.outputs),
                pointer(found.sums),
                pointer(found.counts),
            )
            advance(int(np.clip(rows["steps"][first:stop] - begin, 0, end - begin).sum()))
        return found


def _groups(starts: Rows, steps: Rows) -> tuple[Groups, NDArray[np.void]]:
    """Puts rollouts of similar length into groups of lanes. Returns the groups, and for each lane
    its number of steps and its first row among the outputs. Unused lanes repeat a rollout and have
    0 steps.
    """
    # all lanes run as long as the longest: similar lengths waste the least time
    order = np.argsort(-steps, kind="stable")
    count = -(-len(order) // WIDTH)
    place = np.arange(count * WIDTH).reshape(count, WIDTH)
    members = order[np.minimum(place, len(order) - 1)]
    used = place < len(order)
    groups = np.zeros(count, group_type(WIDTH, DTYPE))
    groups["start"], groups["used"] = starts[members], -used.astype(np.int64)
    # the first one of a group is the longest
    groups["steps"] = steps[members[:, 0]]
    rows = np.zeros(count, _LANE_ROWS)
    rows["steps"] = np.where(used, steps[members], 0)
    # outputs are in the caller's order of rollouts
    rows["row"] = (np.cumsum(steps) - steps)[members]
    return groups, rows


def _calls(steps: Rows) -> list[tuple[int, int, int, int]]:
    """Splits the work into calls of about `_AT_ONCE` steps: (first group, group after the last,
    first step, step after the last) of each. Several short groups share a call, a long one takes
    several. `steps` is the length of each group.
    """
    calls: list[tuple[int, int, int, int]] = []
    first = 0
    done = np.cumsum(steps)
    while first < len(steps):
        if steps[first] > _AT_ONCE:
            whole = int(steps[first])
            calls += [
                (first, first + 1, begin, min(begin + _AT_ONCE, whole))
                for begin in range(0, whole, _AT_ONCE)
            ]
            first += 1
        else:
            before = int(done[first] - steps[first])
            # as many groups as fit in that number of steps, at least one
            stop = max(int(np.searchsorted(done, before + _AT_ONCE, side="right")), first + 1)
            calls.append((first, stop, 0, _AT_ONCE))
            first = stop
    return calls

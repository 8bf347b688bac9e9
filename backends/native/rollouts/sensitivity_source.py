"""Writes the C of a kernel that simulates sensitivities and sums products of slopes."""

from __future__ import annotations

from dataclasses import dataclass

from backends.c_language.functions import FunctionNames
from backends.c_language.places import ArrayView, Index
from backends.native.kept_sources import kept_source
from backends.native.kernel_functions import ModelFunctions, Stored
from backends.native.kernel_source import (
    PREFIX,
    KernelSource,
    LaneFunctions,
    forward_arrays,
    rendered,
    whole_source,
)
from backends.native.lanes.lane_functions import array
from backends.native.lanes.lane_memory import LaneMemory
from compiler.differentiation.sensitivities import Sensitivities
from compiler.differentiation.training_step import forward_only
from compiler.ir.program import NodeId

_BLOCK = 4
"""Rows are as long as a multiple of it; BLOCK of templates/native/sensitivities.c.j2."""

ROWS = "rows"


@dataclass(frozen=True, slots=True)
class SensitivitySource:
    """The kernel's text, and how long a row of slopes, residual and mark is in its products.

    The mark is 1 where a residual is left out, and missing where none can be.
    """

    source: KernelSource
    width: int
    marked: bool


@kept_source
def sensitivity_source(found: Sensitivities) -> SensitivitySource:
    """The kernel of one program whose loops are closed, in float64."""
    memory = LaneMemory(forward_only(found.program, found.losses))
    functions = LaneFunctions(FunctionNames(PREFIX, "float64", "own"))
    marked = any(one.left_out is not None for one in found.residuals)
    # slopes, residual, mark; whole blocks, so that the loop over products has no rest
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
    """The first row of every loss and the last one's end, and where residuals, slopes, marks go."""
    firsts = [0]
    places: list[tuple[NodeId, ArrayView]] = []
    residuals = {residual.loss.name: residual for residual in found.residuals}
    for loss in found.program.losses:
        residual = residuals.get(loss.name)
        if residual is None:
            # a loss that is no sum of squares is summed, but has no rows
            firsts.append(firsts[-1])
            continue
        type = found.program.step[residual.values].type
        each = array(ROWS, type.shape)
        strides = tuple(stride * width for stride in each.strides)
        first = firsts[-1] * width
        values = ArrayView(each.storage, type.shape, strides, Index(first + found.numbers))
        # the learned numbers are the innermost axis: products run along rows
        slopes = ArrayView(each.storage, (found.numbers, *type.shape), (1, *strides), Index(first))
        places += [(residual.values, values), (residual.slopes, slopes)]
        if residual.left_out is not None:
            mark = ArrayView(each.storage, type.shape, strides, Index(first + found.numbers + 1))
            places.append((residual.left_out, mark))
        firsts.append(firsts[-1] + type.size)
    return firsts, tuple(places)

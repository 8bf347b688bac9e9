"""Writes the C code of a kernel that simulates sensitivities and sums their products."""

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
"""The length of rows is a multiple of it; BLOCK of templates/native/sensitivities.c.j2."""

ROWS = "rows"


@dataclass(frozen=True, slots=True)
class SensitivitySource:
    """The kernel source, and the length of a row of derivatives, residual and mark.

    The mark is 1 where a residual is excluded; `marked` is False if none can be.
    """

    source: KernelSource
    width: int
    marked: bool


@kept_source
def sensitivity_source(found: Sensitivities) -> SensitivitySource:
    """The float64 kernel of a program with closed loops."""
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
    """The first row of every loss plus the end, and the places of residuals, derivatives and
    marks.
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

"""Writes the C code of a kernel that stores outputs of rollouts and sums their losses."""

from __future__ import annotations

from dataclasses import dataclass, replace

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
from compiler.differentiation.training_step import forward_only, loss_terms
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import NodeId, Program

_STORED = "outputs"


@dataclass(frozen=True, slots=True)
class RolloutSource:
    """The kernel source, and the number of output elements per step."""

    source: KernelSource
    width: int


@kept_source
def rollout_source(program: Program) -> RolloutSource:
    """The float64 kernel of a program with closed loops, for its outputs and losses."""
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

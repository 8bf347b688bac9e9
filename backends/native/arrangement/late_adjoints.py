"""Computes adjoints of buffer samples when they are needed, instead of scattering them at each
step.

A filter of n taps reads each sample in the n following steps. Going backwards, each step could add
its contribution to the adjoints of all n samples, with n loads and n stores. Instead, the adjoint
of a sample is summed when the loop reaches it, from the n adjoints of the filter's result at later
times and the same taps. That is again a filter, without stores. These adjoints are stored in
reverse order of time, so that both filters access memory in the same way.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from backends.native.arrangement.loop_splitting import Addends, view_leaf
from compiler.differentiation.training_step import TrainingStep
from compiler.ir.ops import Broadcast, Multiply, ReadParameter
from compiler.ir.program import Graph, NodeId
from compiler.ir.types import WINDOW


@dataclass(frozen=True, slots=True)
class LateAdjoint:
    """A term of the adjoint of a buffer: source · taps at every sample in the buffer."""

    state: str
    addend: NodeId
    source: NodeId
    """Without a window axis; otherwise with the axes of the buffer."""
    taps: NodeId
    """A view of a parameter, with the axes of the buffer."""

    @property
    def name(self) -> str:
        return f"echo_{self.addend}"


def late_adjoints(step: TrainingStep) -> tuple[LateAdjoint, ...]:
    """The terms that can be computed late; none if the start has gradients by adjoints of
    buffers.
    """
    # the start needs the adjoint of every initial sample of the buffer, but late adjoints are
    # complete for the newest sample only
    if step.reverse_start.gradients.parameters:
        return ()
    return tuple(_late_adjoints(step))


def _late_adjoints(step: TrainingStep) -> Iterator[LateAdjoint]:
    graph, found = step.reverse_step.graph, step.reverse_step.gradients
    sums = Addends(graph, (*found.states.values(), *found.parameters.values()))
    for state, gradient in found.states.items():
        if state not in step.newest:
            continue
        for addend in sums.of(gradient):
            node = graph[addend]
            if isinstance(node.op, Multiply):
                # either operand may be the parameter
                for source, taps in (node.args, node.args[::-1]):
                    before = _before_window(graph, source)
                    if before is not None and _is_parameter(graph, taps):
                        yield LateAdjoint(state, addend, before, taps)
                        break


def _before_window(graph: Graph, node: NodeId) -> NodeId | None:
    """The operand of a broadcast that only adds the window axis; otherwise None."""
    op, args = graph[node].op, graph[node].args
    if not isinstance(op, Broadcast):
        return None
    axes = graph[node].type.axes
    # other broadcast axes would have to be summed first
    spread = graph[args[0]].type.axes == axes[:-1] and axes[-1].name == WINDOW
    return args[0] if spread else None


def _is_parameter(graph: Graph, node: NodeId) -> bool:
    leaf = view_leaf(graph, node)
    return leaf is not None and isinstance(graph[leaf].op, ReadParameter)

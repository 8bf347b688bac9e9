"""Adjoints of the samples of a buffer, collected when they are needed instead of spread at once.

A filter of n taps over a buffer reads its newest sample at the n steps that follow. Going back,
each step could add its share to the adjoints of all n samples: n loads and n stores. Or the adjoint
of a sample is summed when the loop comes to it, from the n adjoints of the filter's result at later
times with the same taps: a filter again, without stores. Those adjoints are kept in reverse order
of time, so that both filters run over their windows alike.
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
    """An addend of the adjoint of a buffer: source · taps at every sample that the buffer holds."""

    state: str
    addend: NodeId
    source: NodeId
    """Without a window axis; otherwise of the buffer's axes."""
    taps: NodeId
    """A view of a parameter, with the buffer's axes."""

    @property
    def name(self) -> str:
        return f"echo_{self.addend}"


def late_adjoints(step: TrainingStep) -> tuple[LateAdjoint, ...]:
    """The addends that can be collected; none where the start learns from adjoints of buffers."""
    # the start would ask for the adjoint of every sample that the buffer begins with, and those
    # that are collected late are complete for the newest sample alone
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
                # a product has no order: either operand may be the parameter
                for source, taps in (node.args, node.args[::-1]):
                    before = _before_window(graph, source)
                    if before is not None and _is_parameter(graph, taps):
                        yield LateAdjoint(state, addend, before, taps)
                        break


def _before_window(graph: Graph, node: NodeId) -> NodeId | None:
    """The node that a broadcast spreads along the window and nothing else."""
    op, args = graph[node].op, graph[node].args
    if not isinstance(op, Broadcast):
        return None
    axes = graph[node].type.axes
    # along other axes the sum over the spread would have to come first
    spread = graph[args[0]].type.axes == axes[:-1] and axes[-1].name == WINDOW
    return args[0] if spread else None


def _is_parameter(graph: Graph, node: NodeId) -> bool:
    leaf = view_leaf(graph, node)
    return leaf is not None and isinstance(graph[leaf].op, ReadParameter)

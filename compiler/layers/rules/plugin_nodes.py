"""Checks the nodes that a layer or a function of a plug-in adds to a graph."""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

from compiler.ir import ops
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import NodeId
from compiler.ir.rules import AxesOfSources, broken_rule
from spec_schema.diagnostics.source import Span
from spec_schema.plugins import PluginPart

_NO_SOURCES = AxesOfSources(parameters={}, states={}, signals={})


def guarded_expansion(
    part: PluginPart, expand: Callable[..., object], builder: GraphBuilder, place: Span
) -> NodeId:
    """The node that the function `expand` of a plug-in returns. Raises SpecError (E0230) at `place`
    if it fails, returns no node or adds an illegal one.
    """
    known = builder.size

    def fault(node: object) -> str | None:
        return fault_of_result(node, builder) or _fault_of_nodes(builder, known)

    def at() -> Span:
        return place

    return cast("NodeId", part.guarded(expand, fault, at)())


def fault_of_result(node: object, builder: GraphBuilder) -> str | None:
    """The reason why a result of a plug-in is no node of the builder, as the end of a sentence;
    None if it is one.
    """
    if not isinstance(node, int):
        return f"returned a {type(node).__name__}, not a node of the builder"
    if not 0 <= node < builder.size:
        return f"returned {node}, which is no node of the builder"
    return None


def _fault_of_nodes(builder: GraphBuilder, known: int) -> str | None:
    """The first rule that a node with an id from `known` on breaks, as the end of a sentence; None
    if there is none. The verifier checks all rules later.
    """
    for index in range(known, builder.size):
        node = builder.node(index)
        # other leaves read what the spec declares, which the verifier compares
        if not node.args and not isinstance(node.op, ops.Constant):
            continue
        if node.args and not 0 <= min(node.args) <= max(node.args) < index:
            return f"made a node {type(node.op).__name__} of a node that is not there"
        reason = broken_rule(node, tuple(map(builder.type, node.args)), _NO_SOURCES)
        if reason is not None:
            return f"made a wrong node {type(node.op).__name__}: {reason}"
    return None

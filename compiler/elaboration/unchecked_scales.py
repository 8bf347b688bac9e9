"""Warns if `L: 300 uH` is used as 300 in a formula whose units cannot be checked."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import isclose

from compiler.ir import ops
from compiler.ir.graph import Graph, Node
from compiler.ir.program import NodeId, State
from compiler.lowering.constants import number
from compiler.lowering.context import Context
from compiler.lowering.environment import START, STEP
from spec_schema.diagnostics.source import Span
from spec_schema.expressions.tree import Expression
from spec_schema.fields.located import Located
from spec_schema.sections.values import Constant
from spec_schema.units.conversion import report_unconverted
from spec_schema.units.quantity import Quantity
from spec_schema.units.unit import ONE, Unit

_REASON = "it meets a value without unit, and formulas convert nothing"


def report_unchecked_scales(context: Context, states: Iterable[State]) -> None:
    """Reports scaled quantities (`300 uH`) that a formula combines with values of unknown unit.

    There the unit check cannot find a wrong scale. `{init: 300, unit: uH}` states the 300
    explicitly, so it is not reported. A state of unknown unit accepts any unit.
    """
    written = _written(context)
    # most specs have none
    if not written:
        return
    reported: set[str] = set()
    unknown = [state for state in states if state.unit is None]
    for environment, ends in (
        (STEP, {state.next for state in unknown}),
        (START, {state.start for state in unknown}),
    ):
        graph = context.builder(environment).graph()
        carried = _carried(graph, written)
        for index, node in graph:
            names = carried[index] if index in ends else frozenset[str]()
            if _meets_unknown(context, graph, node):
                names |= {name for arg in node.args for name in carried[arg]}
            for name in sorted(names - reported):
                place = () if node.span is None else ((node.span, "here"),)
                report_unconverted(written[name], _REASON, context.findings, place)
            reported |= names


def _written(context: Context) -> dict[str, Quantity]:
    """Parameters and constants that are written as a number with a scaled unit, such as `300
    uH`.
    """
    found: dict[str, Quantity] = {}
    for name, entry in {**context.spec.parameters, **context.spec.constants}.items():
        value = entry.value if isinstance(entry, Constant) else entry.init.choice
        if entry.unit is None or not isinstance(value, Expression):
            continue
        if entry.unit.value.scale == 1.0 and not entry.unit.value.is_level:
            continue
        if _stands_behind(entry.unit, value.span):
            amount = number(context, value, f"`{name}`")
            # `3600 s/h` equals 1: it is a conversion factor
            unit = entry.unit.value
            is_ratio = len(unit.factors) > 1 and unit.same_dimension(ONE)
            if not (is_ratio and isclose(unit.in_si(amount), 1.0)):
                found[name] = Quantity(amount, unit, value.span.to(entry.unit.span))
    return found


def _stands_behind(unit: Located[Unit], value: Span) -> bool:
    """True if the unit was written after the number (`300 uH`), not as `unit: uH`."""
    key, first, last = (
        (span.line, span.column) for span in (unit.key or unit.span, value, unit.span)
    )
    return unit.span.file == value.file and key < first < last


def _carried(graph: Graph, written: Mapping[str, Quantity]) -> list[frozenset[str]]:
    """For each node, the quantities that its value depends on while its unit is scaled.

    A sum with another value of known unit, such as `max(level, 0.1 cm)`, confirms the scale.
    """
    found: list[frozenset[str]] = []
    for _, node in graph:
        unit, of_args = node.type.unit, [found[arg] for arg in node.args]
        match node.op:
            case ops.ReadParameter(name=name) | ops.Constant(name=name) if name in written:
                names = frozenset([name])
            case _ if unit is None or (isclose(unit.scale, 1.0) and not unit.is_level):
                names = frozenset[str]()
            case ops.Add() | ops.Subtract() | ops.Minimum() | ops.Maximum() | ops.Clamp() if any(
                not names and graph[arg].type.unit is not None and not _is_zero(graph, arg)
                for arg, names in zip(node.args, of_args, strict=True)
            ):
                names = frozenset[str]()
            case _:
                names = frozenset[str]().union(*of_args)
        found.append(names)
    return found


def _meets_unknown(context: Context, graph: Graph, node: Node) -> bool:
    """True if another operand has no unit.

    Learned weights of a layer fit any scale and do not count.
    """
    for arg in node.args if len(node.args) > 1 else ():
        operand = graph[graph.unrepeated(arg)]
        is_weight = isinstance(operand.op, ops.ReadParameter) and (
            operand.op.name not in context.spec.parameters
        )
        if operand.type.unit is None and not is_weight and not _is_zero(graph, arg):
            return True
    return False


def _is_zero(graph: Graph, value: NodeId) -> bool:
    op = graph[graph.unrepeated(value)].op
    return isinstance(op, ops.Constant) and not any(op.values)

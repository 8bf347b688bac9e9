"""Lowers equations and outputs, each once for every time and stage at which it is used."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from compiler.elaboration.named_values.histories import Histories
from compiler.elaboration.submodels.connections import fitted_to_input
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import NodeId
from compiler.ir.rules.unit_rules import same_unit
from compiler.ir.types import WINDOW, Type
from compiler.linking.connected import Connected
from compiler.lowering.context import Context
from compiler.lowering.environment import (
    STEP,
    Environment,
    EnvironmentPart,
    IntegratorStage,
    Time,
)
from compiler.lowering.expressions import lower
from compiler.lowering.failure import LoweringFailed
from compiler.lowering.unit_conflicts import report_declared_unit
from spec_schema.diagnostics.source import Span
from spec_schema.errors import states
from spec_schema.sections.signals import Equation, Output


class Entries:
    """The equations and outputs of a context."""

    def __init__(self, context: Context, histories: Histories, variables: frozenset[str]) -> None:
        self._context = context
        self._histories = histories
        self._variables = variables
        # by stage too: an equation has another value at each stage of an integrator (R6)
        self._entries: dict[
            tuple[str, EnvironmentPart, Time, IntegratorStage | None], NodeId | None
        ] = {}
        self._lowerings: dict[tuple[str, EnvironmentPart], list[tuple[Time, NodeId]]] = {}
        """Those of no stage, by name."""
        self._active: dict[str, None] = {}
        """The entries that are being lowered, outermost first."""
        self._loops: list[set[str]] = []
        """Algebraic loops that are reported: entered elsewhere, it is the same loop."""

    def value(
        self, name: str, entry: Equation | Output, environment: Environment, span: Span
    ) -> NodeId:
        """The value of an equation or output, lowered once a time and stage.

        At another time than t every signal in it is read at that time (R1). Where that cannot be,
        because it depends on a state or on itself, its past values are kept.
        """
        own = environment.of_entry()
        stage = own.stage
        if isinstance(entry, Connected) and stage is not None and entry.is_held_for(stage.owner):
            own = own.without_stage()
        # before the start what the spec says of the past wins over what could be evaluated (R5a)
        if own.part is EnvironmentPart.START and own.latest < 0 and entry.history is not None:
            return lower(self._context, entry.history, own)
        if own.is_elsewhere and own.part is EnvironmentPart.STEP:
            own = own.without_stage()
            recomputed = None
            if name not in self._active and not _has_own_past(entry):
                # first choice: f(x)[t-1] is f of x[t-1], which needs memory for x alone
                recomputed = self.tried(lambda: self._lowered(name, entry, own, span))
            if recomputed is not None:
                return recomputed
            # a buffer ends at t: of a future sample `_lowered` reports what cannot be known
            if own.latest <= 0:
                return self._histories.read(name, entry, span, own)
        return self._lowered(name, entry, own, span)

    def lowerings(self, name: str, environment: Environment) -> Sequence[tuple[Time, NodeId]]:
        """Every time at which an entry is lowered in this part, and its node there."""
        return self._lowerings.get((name, environment.of_entry().part), ())

    def types(self) -> dict[str, Type]:
        """The type of one sample of every equation and output that the step has."""
        found: dict[str, Type] = {}
        for (name, part, (_, window), _), node in self._entries.items():
            if part is not EnvironmentPart.STEP or node is None:
                continue
            type = self._context.builder(STEP).type(node)
            if window is None:
                found[name] = type
            else:
                of_sample = tuple(axis for axis in type.axes if axis.name != WINDOW)
                found.setdefault(name, type.with_axes(of_sample))
        return found

    def tried(self, lower_it: Callable[[], NodeId]) -> NodeId | None:
        """The node, or None where lowering fails; nothing is reported and nothing remembered."""
        mark, loops = self._context.findings.mark(), len(self._loops)
        known = len(self._entries)
        try:
            return lower_it()
        except LoweringFailed:
            # a try that fails is no mistake of the user
            self._context.findings.forget(mark)
            del self._loops[loops:]
            for key in list(self._entries)[known:]:
                # entries that did lower stay: they are right, and lowering them again would cost
                # the time twice
                if self._entries[key] is None:
                    del self._entries[key]
            return None

    def _lowered(self, name: str, entry: Equation | Output, own: Environment, span: Span) -> NodeId:
        key = (name, own.part, own.time, own.stage)
        if name in self._active:
            active = list(self._active)
            loop = active[active.index(name) :]
            # the same loop entered at another of its equations has the same members
            if not any(set(loop) == known for known in self._loops):
                self._context.findings.report(states.algebraic_loop((*loop, name), span))
                self._loops.append(set(loop))
            raise LoweringFailed
        if key in self._entries:
            node = self._entries[key]
            if node is None:
                raise LoweringFailed
            return node
        self._active[name] = None
        try:
            self._entries[key] = None  # stays when lowering fails
            node = lower(self._context, entry.expr, own)
            builder = self._context.builder(own)
            if name in self._variables:
                # `2*x` elsewhere is another value than e = 2*x, see decisions/0195
                node = builder.named(node, name)
            if isinstance(entry, Connected):  # whose expression has names of its own
                node = fitted_to_input(self._context, builder, node, name, entry, own)
            else:
                _agree_on_unit(self._context, builder, node, name, entry)
                builder.name(node, name)
            self._entries[key] = node
            # a gradient is taken of the values of a sample, not of those inside the integrator
            if own.stage is None:
                self._lowerings.setdefault((name, own.part), []).append((own.time, node))
        finally:
            del self._active[name]
        return node


def _has_own_past(entry: Equation | Output) -> bool:
    """Whether the past before the start is given, by `history:` or by a log, not evaluated (R5)."""
    return entry.history is not None or (isinstance(entry, Output) and entry.predicts is not None)


def _agree_on_unit(
    context: Context, builder: GraphBuilder, node: NodeId, name: str, entry: Equation | Output
) -> None:
    """Gives a value the declared unit, and its word; reports one that is known and differs."""
    if entry.unit is None:
        return
    found = builder.type(node).unit
    if found is None:
        builder.set_unit(node, entry.unit.value)
    elif not same_unit(found, entry.unit.value):
        report_declared_unit(context, name, found, entry.unit.value, entry.expr.span)
    # what is read as it is keeps the unit that its own entry declares
    elif found.text != entry.unit.value.text and builder.node(node).args:
        builder.rename_unit(node, entry.unit.value)

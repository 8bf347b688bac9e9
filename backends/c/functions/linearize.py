"""Writes the Jacobian of a step in C: checks inputs, writes constants, computes the rest."""

from __future__ import annotations

import numpy as np

from backends.c.functions.function_writer import ControllerCode, FunctionWriter
from backends.c.functions.input_policy import checked_input
from backends.c.functions.jacobian_comments import entries_comment, pattern_comments
from backends.c.functions.number_runs import number_runs
from backends.c.functions.state_reports import report_unready
from backends.c.functions.valid_range import report_outside
from backends.c.interface.jacobian_interface import OUT, JacobianInterface, MatrixField
from backends.c.interface.status import StatusBit
from backends.c_language.places import ArrayView, Index
from backends.c_language.tree import Argument, CType, Declare, Discard, Function, Name, Real, Return
from backends.c_lowering.graph import GraphLowering
from backends.c_lowering.state_memory import DelayLine, PlainState
from compiler.ir.nodes import needed
from compiler.ir.ops import ReadSignal, ReadState
from compiler.ir.program import Graph
from compiler.jacobian.matrices import MatrixBlock

_FEW = 16
"""Maximum number of constant entries that are written one by one."""


def linearize_function(model: ControllerCode, interface: JacobianInterface) -> Function:
    """`<prefix>_linearize(s, p, u, jac)`: the Jacobian of the step at s and u."""
    writer = _LinearizeWriter(model, interface)
    writer.begin()
    graph = interface.jacobian.graph
    roots = interface.jacobian.roots
    lowered = GraphLowering(graph, roots, writer, writer.scope, writer.locals)
    for field in interface.fields:
        writer.comment(f"{field.identifier} = {field.comment}")
        for line in pattern_comments(field.matrix):
            writer.comment(line)
        writer.write_known(field)
        for block in field.matrix.blocks:
            writer.comment(entries_comment(field.matrix, block, graph[block.node].type))
            lowered.store(block.node, _entries(field, block, graph))
    writer.report_infinite(graph)
    writer.scope.add(Return(Name("status")))
    prefix = model.interface.prefix
    structs = (
        Argument(f"const {prefix}_in_t *", "u"),
        Argument(f"{prefix}_jacobian_t *", OUT),
    )
    doc = "Computes the slopes of one step in its states and inputs."
    return writer.finished("linearize", f"{prefix}_status_t", structs, doc, reads_only=True)


def _entries(field: MatrixField, block: MatrixBlock, graph: Graph) -> ArrayView:
    """The place of the entries of a block."""
    shape = graph[block.node].type.shape
    return ArrayView(field.place.storage, shape, block.strides, Index(block.offset))


class _LinearizeWriter(FunctionWriter):
    def __init__(self, model: ControllerCode, interface: JacobianInterface) -> None:
        super().__init__(model, interface.jacobian.graph)
        graph = interface.jacobian.graph
        live = needed(graph, interface.jacobian.roots)
        ops = [node.op for index, node in graph if live[index]]
        self._states = {op.name for op in ops if isinstance(op, ReadState)}
        self._signals = {op.signal for op in ops if isinstance(op, ReadSignal)}
        self._fields = interface.fields

    def begin(self) -> None:
        """Writes the status, the heads of rings that are read, and the checked inputs."""
        interface, scope = self.interface, self.scope
        scope.reserve(OUT)
        if not interface.has_state:
            scope.add(Discard("s"))
        checked = [i for i in interface.inputs if i.port.signal.on_invalid != "trust"]
        if not (self._signals or checked):
            scope.add(Discard("u"))
        if not self._fields:
            scope.add(Discard(OUT))
        ok = Name(f"{interface.prefix.upper()}_OK")
        infinite = any(field.matrix.perhaps_infinite for field in self._fields)
        # otherwise nothing sets a bit
        constant = not (checked or interface.has_state or infinite)
        scope.add(Declare(CType.STATUS, "status", ok, constant=constant))
        for memory in interface.states:
            if not isinstance(memory, PlainState | DelayLine) and memory.state.name in self._states:
                memory.begin(scope)
        report_unready(self)
        if checked:
            self.comment("inputs")
        for input in interface.inputs:
            name = input.port.signal.name
            valid = checked_input(input, self.model.functions, scope, self.unroll, remembers=False)
            self.inputs[name] = valid
            # checked for its status, although no entry reads it
            if name not in self._signals and isinstance(valid.storage, Name):
                scope.add(Discard(valid.storage.text))

    def report_infinite(self, graph: Graph) -> None:
        """Sets a status bit if an entry is infinite or NaN."""
        blocks = [(f, block) for f in self._fields for block in f.matrix.perhaps_infinite]
        if blocks:
            self.comment("slopes that can be infinite")
        # larger entries are infinite; NaN is outside of every range
        largest = float(np.finfo(self.interface.options.dtype).max)
        for field, block in blocks:
            place = _entries(field, block, graph)
            report_outside(self, place, (-largest, largest), StatusBit.SLOPE_NOT_FINITE)

    def write_known(self, field: MatrixField) -> None:
        """Writes the constant entries."""
        known = {i: x for i, x in enumerate(field.matrix.known) if x is not None}
        place, scope = field.place, self.scope
        # if there are many, a loop sets all entries to 0, then the nonzero constants are written
        if len(known) > _FEW:
            with scope.loop(field.matrix.size) as (index, inner):
                inner.assign(place.element([index]), Real(0.0))
            # -0.0 equals 0.0, so +0 from the loop is fine
            known = {i: x for i, x in known.items() if x != 0.0}
        for run in number_runs(known):
            along = ArrayView(place.storage, (run.count,), (run.stride,), Index(run.first))
            scope.each(
                along.shape,
                self.unroll,
                lambda at, inner, run=run, along=along: inner.assign(
                    along.element(at), Real(run.value)
                ),
            )

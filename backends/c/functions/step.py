"""The step of a controller: check inputs, compute, give outputs, then commit all states at once."""

from __future__ import annotations

from backends.c.functions.function_writer import FunctionWriter, Model
from backends.c.functions.input_policy import checked_input
from backends.c.functions.valid_range import report_outside
from backends.c.interface.status import Status, status_macro
from backends.c_language.places import Place
from backends.c_language.tree import (
    Argument,
    Binary,
    Conditional,
    CType,
    Declare,
    Discard,
    Expression,
    Function,
    If,
    Member,
    Name,
    Return,
    SetBits,
    Unsigned,
)
from backends.c_lowering.active_sums import ActiveSets, active_sets
from backends.c_lowering.graph import GraphLowering
from backends.c_lowering.shift_while_summing import moving_sums
from backends.c_lowering.state_memory import Buffer, DelayLine, PlainState, joining, seen_values
from compiler.ir.program import Graph, Program

BUFFERS_EMPTY = 1
"""Bit of the `unset` field: buffers wait for their first sample."""

STATES_UNSET = 2
"""Bit of the `unset` field: states hold values that only `reset` can set."""


def step_function(program: Program, model: Model) -> Function:
    """`<prefix>_step(s, p, u, y)`: one step; returns what was out of order."""
    writer = _StepWriter(model, program.step)
    writer.begin()
    roots = seen_values(program) + [joining(memory) for memory in model.interface.states]
    interface = model.interface
    # which sets are active depends on the numbers
    constant_time = interface.options.constant_time
    active = ActiveSets() if constant_time else active_sets(program.step, roots)
    moving = moving_sums(program.step, roots, interface.states, writer.unroll)
    lowered = GraphLowering(
        program.step, roots, writer, writer.scope, writer.locals, active, moving
    )
    if program.outputs:
        writer.comment("outputs")
    for output, field in zip(program.outputs, interface.outputs, strict=True):
        lowered.store(output.node, field.place("y"))
    writer.check_equations(program, lowered)
    writer.commit(lowered, moved={memory.state.name for memory in moving.values()})
    writer.check_states()
    writer.scope.add(Return(Name("status")))
    prefix = interface.prefix
    structs = (
        Argument(f"const {prefix}_in_t *", "u"),
        Argument(f"{prefix}_out_t *", "y"),
    )
    doc = "One step: outputs of sample t, then the states of sample t+1."
    return writer.finished("step", f"{prefix}_status_t", structs, doc)


def report_unset(writer: FunctionWriter) -> None:
    """Sets a bit of the status while states wait for what only `reset` can give."""
    interface = writer.interface
    if not interface.from_record:
        return
    bit = Name(status_macro(interface.prefix, Status.UNINITIALISED))
    unset = Binary("!=", Member("s", interface.unset), Unsigned(0))
    if interface.options.constant_time:
        known = writer.model.functions.truth(unset)
        writer.scope.add(SetBits(Name("status"), Conditional(known, bit, Unsigned(0))))
    else:
        writer.scope.add(If(unset, (SetBits(Name("status"), bit),)))


class _StepWriter(FunctionWriter):
    def __init__(self, model: Model, graph: Graph) -> None:
        super().__init__(model, graph)
        self._empty = set(model.interface.filled_by_first)

    def begin(self) -> None:
        """Status, heads of rings, checked inputs, and whether the states are set."""
        interface, scope = self.interface, self.scope
        if not interface.inputs:
            scope.add(Discard("u"))
        if not interface.outputs:
            scope.add(Discard("y"))
        if not interface.has_state:
            scope.add(Discard("s"))
        ok = Name(f"{interface.prefix.upper()}_OK")
        scope.add(Declare(CType.STATUS, "status", ok))
        for memory in interface.states:
            if not isinstance(memory, PlainState | DelayLine):
                memory.begin(scope)
        if interface.inputs:
            self.comment("inputs")
        for input in interface.inputs:
            self.inputs[input.port.signal.name] = checked_input(
                input, self.model.functions, scope, self.unroll
            )
        report_unset(self)  # last, so that compilers join it with filling the buffers

    def before_push(self, memory: Buffer, newest: Place) -> None:
        if memory.state.name in self._empty:
            inner = self.scope.inner()
            memory.fill(newest, inner, self.unroll)
            self._empty.remove(memory.state.name)
            if not self._empty:
                inner.assign(self._unset, self._unset_after_first())
            self.scope.add(If(self._marked(BUFFERS_EMPTY), tuple(inner.statements)))

    def commit(self, lowered: GraphLowering, moved: set[str]) -> None:
        """Replaces the states; what is made of old states is computed before the first of them.

        Buffers that have `moved` while a sum read them are left as they are.
        """
        interface = self.interface
        following: list[tuple[PlainState | DelayLine, Place]] = []
        if interface.states:
            self.comment("next states")
        for memory in interface.states:
            if isinstance(memory, PlainState | DelayLine):
                node, name = joining(memory), f"{memory.state.name}_next"
                place = lowered.place(node, name)
                if place != memory.samples:
                    if isinstance(place.storage, Member) and place.storage.base == "s":
                        place = lowered.copy(node, name)
                    following.append((memory, place))
        for memory, place in following:
            memory.write(place, self.scope, self.unroll)
        for memory in interface.states:
            if not isinstance(memory, PlainState | DelayLine) and memory.state.name not in moved:
                memory.commit(self.scope, self.unroll)
        assert not self._empty  # every one was pushed, so that its bit is gone after a step

    def check_equations(self, program: Program, lowered: GraphLowering) -> None:
        """Reports equations outside their range."""
        for entry in program.expected:
            low, high = entry.range
            self.comment(f"expected of {entry.name}: {low:.9g} .. {high:.9g}")
            value = lowered.place(entry.node, f"{entry.name}_checked")
            shape = program.step[entry.node].type.shape
            report_outside(self, value, shape, entry.range, Status.EQUATION_OUT_OF_RANGE)

    def check_states(self) -> None:
        """Reports declared states outside their range."""
        for memory in self.interface.states:
            if isinstance(memory, PlainState) and memory.state.range is not None:
                limits = memory.state.range
                report_outside(
                    self, memory.samples, memory.shape, limits, Status.STATE_OUT_OF_RANGE
                )

    @property
    def _unset(self) -> Member:
        return Member("s", self.interface.unset)

    def _unset_after_first(self) -> Expression:
        interface = self.interface
        only_buffers = interface.filled_by_first == interface.from_record
        return Unsigned(0) if only_buffers else Binary("&", self._unset, Unsigned(STATES_UNSET))

    def _marked(self, bit: int) -> Binary:
        return Binary("!=", Binary("&", self._unset, Unsigned(bit)), Unsigned(0))

"""Writes the step: check inputs, compute, write outputs, then commit all states together."""

from __future__ import annotations

from backends.c.functions.function_writer import ControllerCode, FunctionWriter
from backends.c.functions.input_policy import checked_input
from backends.c.functions.state_reports import (
    BUFFERS_EMPTY,
    INITIALISED,
    STATES_UNSET,
    report_next_states,
    report_not_a_number,
    report_outside,
    report_unready,
)
from backends.c.interface.status import StatusBit
from backends.c.interface.structs import step_text
from backends.c_language import tree as c
from backends.c_language.places import ArrayView
from backends.c_lowering.fuzzy_sets import ActiveSums, find_active_sums
from backends.c_lowering.graph import GraphLowering
from backends.c_lowering.state_memory import Buffer, DelayLine, PlainState, joining, seen_values
from backends.c_lowering.sums import shifting_sums
from compiler.ir.program import Graph, Program
from compiler.passes.analyses.saturation import unsaturated


def step_function(program: Program, model: ControllerCode) -> c.Function:
    """The C function `<prefix>_step(s, p, u, y)`: computes outputs y from inputs u, changes the
    states s, and returns status bits.
    """
    writer = _StepWriter(model, program.step)
    writer.begin()
    roots = seen_values(program) + [joining(memory) for memory in model.interface.states]
    interface = model.interface
    # the set of active fuzzy sets depends on the data
    constant_time = interface.options.constant_time
    # in constant time every membership is computed in each step
    active = ActiveSums() if constant_time else find_active_sums(program.step, roots)
    moving = shifting_sums(program.step, roots, interface.states, writer.unroll)
    lowered = GraphLowering(
        program.step, roots, writer, writer.scope, writer.locals, active, moving
    )
    if program.outputs:
        writer.comment("outputs")
    for output, field in zip(program.outputs, interface.outputs, strict=True):
        lowered.store(output.node, field.place("y"))
    writer.check_equations(program, lowered)
    writer.check_saturated(program, lowered)
    # states are committed last: outputs and next states use the old values (R1)
    writer.commit(lowered, moved={memory.state.name for memory in moving.values()})
    report_next_states(writer)
    writer.scope.add(c.Return(c.Name("status")))
    prefix = interface.prefix
    structs = (
        c.Argument(f"const {prefix}_in_t *", "u"),
        c.Argument(f"{prefix}_out_t *", "y"),
    )
    text = step_text(interface.late)
    return writer.finished("step", f"{prefix}_status_t", structs, text)


class _StepWriter(FunctionWriter):
    def __init__(self, model: ControllerCode, graph: Graph) -> None:
        super().__init__(model, graph)
        self._empty = set(model.interface.filled_by_first)

    def begin(self) -> None:
        """Writes the declaration of the status, the heads of the ring buffers, the checks of the
        inputs, and the check that states were initialised.
        """
        interface, scope = self.interface, self.scope
        if not interface.inputs:
            scope.add(c.Discard("u"))
        if not interface.outputs:
            scope.add(c.Discard("y"))
        if not interface.has_state:
            scope.add(c.Discard("s"))
        ok = c.Name(f"{interface.prefix.upper()}_OK")
        scope.add(c.Declare(c.CType.STATUS, "status", ok))
        for memory in interface.states:
            if not isinstance(memory, PlainState | DelayLine):
                memory.begin(scope)
        if interface.inputs:
            self.comment("inputs")
        for input in interface.inputs:
            self.inputs[input.port.signal.name] = checked_input(
                input, self.model.functions, scope, self.unroll
            )
        report_unready(self)  # last, so that compilers merge it with filling the buffers

    def before_push(self, memory: Buffer, newest: ArrayView) -> None:
        if memory.state.name in self._empty:
            inner = self.scope.inner()
            memory.fill(newest, inner, self.unroll)
            self._empty.remove(memory.state.name)
            # the last buffer clears the mark: in the first step each is filled at its push
            if not self._empty:
                filled = c.Unsigned(INITIALISED | STATES_UNSET)
                inner.assign(self._ready, c.Binary("&", self._ready, filled))
            self.scope.add(c.If(self._marked(BUFFERS_EMPTY), tuple(inner.statements)))

    def commit(self, lowered: GraphLowering, moved: set[str]) -> None:
        """Writes the next values into the states. Values that read old states are computed or
        copied before. Skips the buffers named in `moved`, which a sum already shifted while it read
        them.
        """
        interface = self.interface
        following: list[tuple[PlainState | DelayLine, ArrayView]] = []
        if interface.states:
            self.comment("next states")
        for memory in interface.states:
            if isinstance(memory, PlainState | DelayLine):
                node, name = joining(memory), f"{memory.state.name}_next"
                place = lowered.place(node, name)
                # a constant state needs no statement
                if place != memory.samples:
                    # the old value of another state, which may be replaced first: copy it
                    if isinstance(place.storage, c.Member) and place.storage.base == "s":
                        place = lowered.copy(node, name)
                    following.append((memory, place))
        # after all copies, as a value may be an old state that another statement replaces
        for memory, place in following:
            memory.write(place, self.scope, self.unroll)
        for memory in interface.states:
            if not isinstance(memory, PlainState | DelayLine) and memory.state.name not in moved:
                memory.commit(self.scope, self.unroll)
        assert not self._empty  # all buffers were pushed, so the bit is cleared after a step

    def check_equations(self, program: Program, lowered: GraphLowering) -> None:
        """Writes checks that report values of equations outside the range `expected` of the
        spec.
        """
        for entry in program.expected:
            low, high = entry.range
            self.comment(f"expected of {entry.name}: {low:.9g} .. {high:.9g}")
            value = lowered.place(entry.node, f"{entry.name}_checked")
            report_outside(self, value, entry.range, StatusBit.EQUATION_OUT_OF_RANGE)

    def check_saturated(self, program: Program, lowered: GraphLowering) -> None:
        """Writes checks that report states with `on_range: saturate` whose next value is NaN before
        the limit.
        """
        for name, node in unsaturated(program).items():
            self.comment(f"next value of {name}: a number")
            report_not_a_number(self, lowered.place(node, f"{name}_unsaturated"))

    @property
    def _ready(self) -> c.Member:
        return c.Member("s", self.interface.ready)

    def _marked(self, bit: int) -> c.Binary:
        return c.Binary("!=", c.Binary("&", self._ready, c.Unsigned(bit)), c.Unsigned(0))

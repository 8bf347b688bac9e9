"""The functions that set the states before the first step: `init` without data, `reset` with it."""

from __future__ import annotations

from backends.c.functions.function_writer import FunctionWriter, Model
from backends.c.functions.input_policy import stand_in
from backends.c.functions.step import BUFFERS_EMPTY, STATES_UNSET
from backends.c.interface.structs import RESERVED
from backends.c_language.places import Place
from backends.c_language.tree import Argument, Assign, Discard, Function, Member, Real, Unsigned
from backends.c_lowering.graph import GraphLowering
from backends.c_lowering.state_memory import member_place
from backends.c_lowering.values import copy_value
from compiler.ir.program import Program


def init_function(program: Program, model: Model) -> Function:
    """`<prefix>_init(s, p)`: states that need no record; the others are marked as not set."""
    writer = _StartWriter(model, program.start)
    interface = model.interface
    known = [s.name for s in program.states if s.name not in interface.from_record]
    writer.set_states(program, dict.fromkeys(known))
    for memory in interface.states:
        if memory.state.name in interface.from_record:
            memory.write_start(_zeros(memory.shape), writer.scope, writer.unroll)
    unset = BUFFERS_EMPTY if interface.filled_by_first else 0
    unset |= STATES_UNSET if interface.from_record - interface.filled_by_first else 0
    writer.finish_states(unset)
    return writer.finished("init", "void", (), "Before the first step, where no past is known.")


def reset_function(program: Program, model: Model) -> Function:
    """`<prefix>_reset(s, p, x0)`: all states, from samples around the first step."""
    writer = _StartWriter(model, program.start)
    interface = model.interface
    if not (interface.windows or interface.supplied):
        writer.scope.add(Discard("x0"))
    supplied = {state.name: field.place("x0") for field, state in interface.supplied}
    writer.set_states(program, {s.name: supplied.get(s.name) for s in program.states})
    writer.finish_states(0)
    prefix = interface.prefix
    structs = (Argument(f"const {prefix}_init_t *", "x0"),)
    return writer.finished("reset", "void", structs, "Before the first step, from a known past.")


class _StartWriter(FunctionWriter):
    def set_states(self, program: Program, starts: dict[str, Place | None]) -> None:
        """Sets the named states to a place, or where it is None to what the start graph says."""
        computed = [s.start for s in program.states if s.name in starts and starts[s.name] is None]
        lowered = GraphLowering(program.start, computed, self, self.scope, self.locals)
        for memory in self.interface.states:
            name = memory.state.name
            if name in starts:
                place = starts[name] or lowered.place(memory.state.start, name)
                memory.write_start(place, self.scope, self.unroll)

    def finish_states(self, unset: int) -> None:
        """Sets what the state struct holds besides the states."""
        interface = self.interface
        for input in interface.inputs:
            if input.held is not None:
                valid = Place.single(Real(stand_in(input.port.signal, interface.options.dtype)))
                held = member_place("s", input.held, input.field.shape)
                copy_value(valid.reshaped_single(held.shape), held, self.scope, self.unroll)
        if interface.from_record:
            self.scope.add(Assign(Member("s", interface.unset), Unsigned(unset)))
        if not interface.has_state:
            self.scope.add(Assign(Member("s", RESERVED), Unsigned(0)))


def _zeros(shape: tuple[int, ...]) -> Place:
    return Place.single(Real(0.0)).reshaped_single(shape)

"""Writes the functions that initialise the states: `init` without data, `reset` with data."""

from __future__ import annotations

from dataclasses import replace

from backends.c.functions.function_writer import ControllerCode, FunctionWriter
from backends.c.functions.input_policy import checked_window, stand_in
from backends.c.functions.state_reports import (
    BUFFERS_EMPTY,
    INITIALISED,
    STATES_UNSET,
    report_first_states,
)
from backends.c.interface.structs import RESERVED
from backends.c_language import tree as c
from backends.c_language.places import ArrayView
from backends.c_lowering.graph import GraphLowering
from backends.c_lowering.state_memory import DoubledRing, member_place
from backends.c_lowering.values import copy_value
from compiler.ir.program import Program


def init_function(program: Program, model: ControllerCode) -> c.Function:
    """`<prefix>_init(s, p)`: sets states that need no recorded samples. The others become 0 and
    stay marked as unset in the field `ready`.
    """
    writer = _StartWriter(model, program.start)
    interface = model.interface
    known = [s.name for s in program.states if s.name not in interface.from_record]
    writer.set_states(program, dict.fromkeys(known))
    for memory in interface.states:
        if memory.state.name in interface.from_record:
            # a defined value, but not valid: `ready` marks states to be set before a step
            memory.write_start(_zeros(memory.shape), writer.scope, writer.unroll)
    ready = INITIALISED
    ready |= BUFFERS_EMPTY if interface.filled_by_first else 0
    ready |= STATES_UNSET if interface.from_record - interface.filled_by_first else 0
    writer.finish_states(ready)
    return writer.finished("init", "void", (), "Initialises the state without history.")


def reset_function(program: Program, model: ControllerCode) -> c.Function:
    """`<prefix>_reset(s, p, x0)`: sets all states, from samples around the first step in x0. The C
    function returns status bits for invalid samples and for states out of range.
    """
    writer = _StartWriter(model, program.start)
    interface = model.interface
    if not (interface.windows or interface.supplied):
        writer.scope.add(c.Discard("x0"))
    writer.check_windows()
    supplied = {state.name: field.place("x0") for field, state in interface.supplied}
    writer.set_states(program, {s.name: supplied.get(s.name) for s in program.states})
    writer.finish_states(INITIALISED)
    if interface.checks:
        # after the states are set, which moves the heads
        writer.read_heads()
        report_first_states(writer)
    writer.scope.add(c.Return(c.Name("status")))
    prefix = interface.prefix
    structs = (c.Argument(f"const {prefix}_init_t *", "x0"),)
    doc = "Initialises the state from a known past; returns what was out of order."
    return writer.finished("reset", f"{prefix}_status_t", structs, doc)


def restart_functions(program: Program, model: ControllerCode) -> tuple[c.Function, ...]:
    """One static function `<prefix>_restart_<state>(s, p)` for each state with `on_range: reset`;
    it sets that state to its initial value.
    """
    found: list[c.Function] = []
    for memory in model.interface.states:
        if memory.state.on_range == "reset":
            writer = _StartWriter(model, program.start)
            writer.set_states(program, {memory.state.name: None})
            doc = f"Resets {memory.state.name} to what it is before the first step."
            function = writer.finished(f"restart_{memory.identifier}", "void", (), doc)
            # only the step calls it, so it is not in the header
            found.append(replace(function, static=True))
    return tuple(found)


class _StartWriter(FunctionWriter):
    def set_states(self, program: Program, starts: dict[str, ArrayView | None]) -> None:
        """Writes the initial values of the states that `starts` names: from the given place, or,
        for None, computed by the start graph.
        """
        computed = [s.start for s in program.states if s.name in starts and starts[s.name] is None]
        # only for the named states: starts of other states are not computed
        lowered = GraphLowering(program.start, computed, self, self.scope, self.locals)
        for memory in self.interface.states:
            name = memory.state.name
            if name in starts:
                place = starts[name] or lowered.place(memory.state.start, name)
                memory.write_start(place, self.scope, self.unroll)

    def check_windows(self) -> None:
        """Writes the declaration of the status, and the checks of the samples around t0."""
        interface = self.interface
        checked = [f for f, port in interface.windows if port.signal.on_invalid != "trust"]
        ok = c.Name(f"{interface.prefix.upper()}_OK")
        # without checks nothing sets a bit
        constant = not (checked or interface.checks)
        self.scope.add(c.Declare(c.CType.STATUS, "status", ok, constant=constant))
        for field, port in interface.windows:
            self.checked_windows[field.name] = checked_window(
                field, port, self.model.functions, self.scope, self.unroll
            )

    def read_heads(self) -> None:
        """Writes declarations of the heads (write positions) of those ring buffers whose samples
        are checked.
        """
        for check in self.interface.checks:
            if isinstance(check.memory, DoubledRing):
                check.memory.begin(self.scope)

    def finish_states(self, ready: int) -> None:
        """Writes the other fields of the state struct: held inputs become the valid value nearest
        to 0, and the field `ready` the bits `ready`.
        """
        interface = self.interface
        for input in interface.inputs:
            if input.held is not None:
                valid = ArrayView.single(
                    c.Real(stand_in(input.port.signal, interface.options.dtype))
                )
                held = member_place("s", input.held, input.field.shape)
                copy_value(valid.reshaped_single(held.shape), held, self.scope, self.unroll)
        if interface.has_state:
            self.scope.add(c.Assign(c.Member("s", interface.ready), c.Unsigned(ready)))
        else:
            # C has no empty structs: sets an unused member
            self.scope.add(c.Assign(c.Member("s", RESERVED), c.Unsigned(0)))


def _zeros(shape: tuple[int, ...]) -> ArrayView:
    return ArrayView.single(c.Real(0.0)).reshaped_single(shape)

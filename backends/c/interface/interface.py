"""Plans the interface of the generated C: its structs, their fields, and the comment of each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from backends.c.interface.jacobian_interface import JacobianInterface, jacobian_interface
from backends.c.interface.status import StateCheck, state_checks
from backends.c_language.places import ArrayView
from backends.c_lowering.options import COptions
from backends.c_lowering.spec_notes import span_text
from backends.c_lowering.state_memory import (
    DelayLine,
    DoubledRing,
    InPlace,
    PlainState,
    ShiftBuffer,
    StateMemory,
    doubles,
    joining,
    kept_in_place,
    member_place,
    seen_values,
)
from backends.c_lowering.sums import shifting_sums
from backends.ports.identifiers import c_identifier
from backends.ports.step_interface import Port, step_interface
from compiler.ir.ops import ReadLog
from compiler.ir.program import Output, Parameter, Program, State, Tape
from compiler.ir.types import WINDOW, Axis, Type
from spec_schema.diagnostics.source import Span
from spec_schema.units.unit import Unit


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """A named value in a C struct: a real, or an array of the shape of its axes in C order."""

    name: str
    """Name in the spec."""
    identifier: str
    axes: tuple[Axis, ...]
    unit: Unit | None
    comment: str

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(axis.size for axis in self.axes)

    @property
    def size(self) -> int:
        return math.prod(self.shape)

    def place(self, base: str, *, pointer: bool = True) -> ArrayView:
        return member_place(base, self.identifier, self.shape, pointer=pointer)


@dataclass(frozen=True, slots=True)
class InputField:
    """An input of the step: its field in the C struct, the port of the program, and the field of
    its last valid value.
    """

    field: Field
    port: Port
    held: str | None
    """Field of the state struct with the last valid value, for the policy `hold`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Interface:
    """The public structs of one program's C code: each field with name, shape, unit and comment, in
    the order of the header.
    """

    model: str
    """Name of the program."""
    prefix: str
    options: COptions
    inputs: tuple[InputField, ...]
    outputs: tuple[Field, ...]
    parameters: tuple[Field, ...]
    states: tuple[StateMemory, ...]
    windows: tuple[tuple[Field, Port], ...]
    """Samples around t0 from which `reset` computes states."""
    supplied: tuple[tuple[Field, State], ...]
    """States whose start depends on future samples, such as fitted ones: `reset` receives their
    values."""
    from_record: frozenset[str]
    """States that need recorded samples: only `reset` can set them, not `init`."""
    ready: str
    """Field of the state struct that marks initialised states; exists if `has_state`."""
    checks: tuple[StateCheck, ...]
    """Checks of the states that step and reset compute."""
    checks_equations: bool
    """True if the step reports equations outside their range."""
    late: int
    """Number of samples by which outputs are older than the inputs of their step."""
    jacobian: JacobianInterface | None
    """None if no Jacobian is requested."""

    @property
    def has_state(self) -> bool:
        """True if the state struct has at least one field."""
        return bool(self.states) or any(input.held for input in self.inputs)

    @property
    def calibrates(self) -> bool:
        """True if a variable in a separate section contains the parameters and their checksum."""
        return self.takes_parameters and self.options.params == "calibration"

    @property
    def calibration_section(self) -> str:
        """The name of the linker section of that variable. Linker scripts that list `.data.*`
        include it, others can place it.
        """
        return f".data.{self.prefix}_calibration"

    @property
    def takes_parameters(self) -> bool:
        """True if functions have a pointer to parameters."""
        return bool(self.parameters) and self.options.params != "inline"

    @property
    def hashes_slopes(self) -> bool:
        """True if golden steps compare a hash of the Jacobian, which requires exact bits."""
        return self.jacobian is not None and bool(self.jacobian.fields) and self.options.is_exact

    @property
    def filled_by_first(self) -> frozenset[str]:
        """Names of the buffers in `from_record` that, after `init`, the first step fills with
        copies of its first sample. Tapes and delay lines are none of them.
        """
        return frozenset(
            memory.state.name
            for memory in self.states
            if memory.state.name in self.from_record
            and not isinstance(memory, PlainState | DelayLine)
            and not isinstance(memory.state.origin, Tape)
        )


def c_interface(program: Program, options: COptions) -> Interface:
    """The C interface of a program in step form. Raises ValueError for a program in window form."""
    prefix = c_identifier(options.prefix or program.name, set())
    newest = _newest_of_record(program)
    # a fitted start needs later samples than its graph reads: 1 means after t0
    newest |= {state.name: 1 for state in program.states if state.fit_over is not None}
    # samples after t0 do not exist yet when a device starts
    supplied = {name for name, sample in newest.items() if sample > 0}
    computed = tuple(state for state in program.states if state.name not in supplied)
    step, start = step_interface(program), step_interface(replace(program, states=computed))
    used = {parameter.name for parameter in (*step.parameters, *start.start_parameters)}
    # names of fields are unique within a struct
    in_inputs, in_outputs, in_parameters, in_states, in_reset = (
        _FieldNames(prefix) for _ in range(5)
    )
    # before the states, so that its name is the same in every model
    ready = in_states.add("ready")
    in_place = kept_in_place(program)
    states = tuple(
        _memory(state, in_states, options, in_place.get(state.name)) for state in program.states
    )
    roots = seen_values(program) + [joining(memory) for memory in states]
    # sums are planned first; then the buffers that a sum shifts are marked
    moving = set(shifting_sums(program.step, roots, states, options.unroll).values())
    states = tuple(
        replace(memory, in_sum=True)
        if isinstance(memory, ShiftBuffer) and memory in moving
        else memory
        for memory in states
    )
    return Interface(
        model=program.name,
        prefix=prefix,
        options=options,
        inputs=tuple(_input(port, in_inputs, in_states) for port in step.inputs),
        outputs=tuple(_output(output, program, in_outputs) for output in program.outputs),
        parameters=tuple(
            in_parameters.field(p.name, p.axes, p.unit, parameter_comment(p))
            for p in program.parameters
            if p.name in used
        ),
        states=states,
        windows=tuple((_window(port, in_reset), port) for port in start.start_windows),
        supplied=tuple(
            (in_reset.field(state.name, state.axes, state.unit, supplied_comment(state)), state)
            for state in program.states
            if state.name in supplied
        ),
        from_record=frozenset(newest),
        ready=ready,
        # computed here, so that the header, its description and the code agree
        checks=state_checks(program, states, in_place, options.dtype),
        checks_equations=bool(program.expected),
        late=program.late,
        jacobian=jacobian_interface(program, options, prefix),
    )


class _FieldNames:
    """Chooses unique C identifiers for the fields of one struct. None starts like a macro of the
    header (`<PREFIX>_`), in upper or lower case.
    """

    def __init__(self, prefix: str) -> None:
        self._macros = f"{prefix}_".lower()
        self._taken: set[str] = set()

    def add(self, name: str) -> str:
        plain = c_identifier(name, set())
        # a field with the name of a macro of the header would be replaced
        if plain.lower().startswith(self._macros):
            plain = f"v_{plain}"
        return c_identifier(plain, self._taken)

    def field(self, name: str, axes: tuple[Axis, ...], unit: Unit | None, comment: str) -> Field:
        """A field for a name of the spec, with a new identifier of this struct."""
        return Field(name=name, identifier=self.add(name), axes=axes, unit=unit, comment=comment)


def _newest_of_record(program: Program) -> dict[str, int]:
    """For each state whose start reads the log: the newest sample that it reads, as an offset from
    t0 (0 is t0, 1 the sample after).
    """
    newest: list[int | None] = []
    for _, node in program.start:
        reads = [sample for arg in node.args if (sample := newest[arg]) is not None]
        if isinstance(node.op, ReadLog):
            reads.append(node.op.last)
        newest.append(max(reads, default=None))
    starts = {state.name: newest[state.start] for state in program.states}
    return {name: sample for name, sample in starts.items() if sample is not None}


def _input(port: Port, names: _FieldNames, states: _FieldNames) -> InputField:
    signal = port.signal
    field = names.field(signal.name, port.type.axes, signal.unit, input_comment(port))
    held = states.add(f"{signal.name}.held") if signal.on_invalid == "hold" else None
    return InputField(field, port, held)


def _output(output: Output, program: Program, names: _FieldNames) -> Field:
    type = program.step[output.node].type
    limits = program.expected_range(output.name)
    comment = output_comment(output, type, limits, program.late)
    return names.field(output.name, type.axes, type.unit, comment)


def _window(port: Port, names: _FieldNames) -> Field:
    signal = port.signal
    # a single sample has no time axis
    axes = signal.axes if port.first == port.last else port.type.axes
    return names.field(signal.name, axes, signal.unit, window_comment(port))


def _memory(
    state: State, names: _FieldNames, options: COptions, in_place: InPlace | None
) -> StateMemory:
    shape = tuple(axis.size for axis in state.axes)
    identifier = names.add(state.name)
    if in_place is None:
        return PlainState(state, identifier, shape)
    # the window with its newest sample is not read: no room for it is needed
    if not in_place.window_read and not doubles(options.ring, shape[-1]):
        return DelayLine(state, identifier, shape, in_place.newest)
    if doubles(options.ring, shape[-1]):
        return DoubledRing(state, identifier, shape, names.add(f"{state.name}.head"))
    return ShiftBuffer(state, identifier, shape)


def input_comment(port: Port) -> str:
    signal = port.signal
    when = _samples("t", port.first, port.last) if (port.first, port.last) != (0, 0) else ""
    limits = _limits(signal.range)
    return _comment(signal.unit, port.type.axes, (limits, when, signal.doc), signal.span)


def window_comment(port: Port) -> str:
    """The header's comment on an argument of `reset` with samples around t0: unit, axes, sample
    times, documentation and place in the spec.
    """
    signal = port.signal
    when = _samples("t0", port.first, port.last)
    return _comment(signal.unit, port.type.axes, (when, signal.doc), signal.span)


def supplied_comment(state: State) -> str:
    return _comment(state.unit, state.axes, ("value at t0", state.doc), state.span)


def output_comment(
    output: Output, type: Type, limits: tuple[float, float] | None, late: int
) -> str:
    """The header's comment on an output: unit, axes, range (`limits`), the signal and sample that
    it predicts, documentation and place in the spec. Outputs are `late` samples older than the
    inputs of their step.
    """
    means = ""
    if output.predicts is not None:
        # relative to the newest input of the step, t: a late step predicts less far ahead
        ahead = output.predicts.ahead - late
        means = f"predicts {output.predicts.signal}[t{f'{ahead:+d}' if ahead else ''}]"
    return _comment(type.unit, type.axes, (_limits(limits), means, output.doc), output.span)


def parameter_comment(parameter: Parameter) -> str:
    return _comment(parameter.unit, parameter.axes, (parameter.doc,), parameter.span)


def state_comment(memory: StateMemory) -> str:
    state = memory.state
    match memory:
        case PlainState():
            kept = ""
        case DelayLine():
            kept = "last sample" if memory.shape[-1] == 1 else "last samples, oldest first"
        case ShiftBuffer():
            kept = "last samples, oldest first, and room for the newest"
        case DoubledRing():
            kept = f"ring of {memory.length} samples, each kept twice"
    return _comment(state.unit, state.axes, (_limits(state.range), kept, state.doc), state.span)


def _comment(
    unit: Unit | None, axes: Sequence[Axis], facts: Sequence[str], span: Span | None
) -> str:
    parts = [f"[{unit.text}]"] if unit is not None else []
    # the declaration shows the size of a single axis
    if len(axes) > 1:
        sizes = [f"{axis.name if axis.name != WINDOW else 't'} {axis.size}" for axis in axes]
        parts.append(f"{' x '.join(sizes)};")
    parts.append("; ".join(fact.strip() for fact in facts if fact.strip()))
    if span is not None:
        parts.append(f"({span_text(span)})")
    return " ".join(part for part in parts if part)


def _limits(range: tuple[float, float] | None) -> str:
    # nine digits identify every float32
    return "" if range is None else f"{range[0]:.9g} .. {range[1]:.9g}"


def _samples(now: str, first: int, last: int) -> str:
    """The samples from offset `first` to `last` in words: `samples t-3 .. t`, or `sample t-3` if
    both are equal. `now` is the name of offset 0, `t` or `t0`.
    """
    begin, end = (f"{now}{offset:+d}" if offset else now for offset in (first, last))
    return f"sample {end}" if first == last else f"samples {begin} .. {end}"

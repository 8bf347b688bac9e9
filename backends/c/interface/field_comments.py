"""Writes the comment of each field of the header: unit, limits, axes, meaning, spec line."""

from __future__ import annotations

from collections.abc import Sequence

from backends.c_lowering.spec_notes import span_text
from backends.c_lowering.state_memory import (
    DelayLine,
    DoubledRing,
    PlainState,
    ShiftBuffer,
    StateMemory,
)
from backends.ports.step_interface import Port
from compiler.ir.program import Output, Parameter, State
from compiler.ir.types import WINDOW, Axis, Type
from spec_schema.diagnostics.source import Span
from spec_schema.units.unit import Unit


def input_comment(port: Port) -> str:
    signal = port.signal
    when = _samples("t", port.first, port.last) if (port.first, port.last) != (0, 0) else ""
    limits = _limits(signal.range)
    return _comment(signal.unit, port.type.axes, (limits, when, signal.doc), signal.span)


def window_comment(port: Port) -> str:
    """The comment of recorded samples around t0."""
    signal = port.signal
    when = _samples("t0", port.first, port.last)
    return _comment(signal.unit, port.type.axes, (when, signal.doc), signal.span)


def supplied_comment(state: State) -> str:
    return _comment(state.unit, state.axes, ("value at t0", state.doc), state.span)


def output_comment(
    output: Output, type: Type, limits: tuple[float, float] | None, late: int
) -> str:
    """The comment of an output, which is `late` samples older than the inputs of its step."""
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
    """`samples t-3 .. t` for a window, `sample t-3` for a delayed sample."""
    begin, end = (f"{now}{offset:+d}" if offset else now for offset in (first, last))
    return f"sample {end}" if first == last else f"samples {begin} .. {end}"

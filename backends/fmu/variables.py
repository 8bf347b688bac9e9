"""Lists the variables of a unit, with their C storage and their descriptions from the spec."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.c.functions.input_policy import nearest_to_zero
from backends.c.interface.interface import Field, Interface
from backends.c.interface.structs import step_text
from backends.c_language.literals import Dtype
from backends.c_lowering.state_memory import PlainState
from backends.fmu.variable import (
    Range,
    UnitVariables,
    Variable,
    VariableKind,
    VariableNames,
    one_line,
    placed,
)
from backends.ports.step_interface import Port
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.program import Declared, Parameter, Program, State

Weights = Mapping[str, NDArray[Any]]

FIRST = "first"
"""The member of the C struct with first values of states that need no recording."""


def unit_variables(program: Program, interface: Interface, weights: Weights) -> UnitVariables:
    """The variables of a program in step form: inputs, outputs, declared states, parameters,
    samples around the first step, and first values of states. `weights` are physical arrays by
    name.
    """
    names = VariableNames()
    found = [
        # the order of this list is that of the references, which importers keep: new kinds come
        # last
        *_inputs(interface, names),
        *_outputs(program, interface, names),
        *_states(interface, names),
        *_parameters(program, interface, weights, names),
        *_samples(interface, names),
        *_first_values(program, interface, weights, names),
    ]
    return UnitVariables(placed(found), names.add("status"), names.add("time"))


def _inputs(interface: Interface, names: VariableNames) -> Iterable[Variable]:
    dtype = interface.options.dtype
    for input in interface.inputs:
        signal, field = input.port.signal, input.field
        yield Variable(
            name=names.add(signal.name),
            kind=VariableKind.INPUT,
            place=f"u.{field.identifier}",
            axes=field.axes,
            unit=signal.unit,
            range=rounded_range(signal.range, dtype),
            doc=one_line(signal.doc, _sample(input.port)),
            start=_valid(field, signal.range, dtype),
            first_sample=input.port.first,
        )


def _outputs(program: Program, interface: Interface, names: VariableNames) -> Iterable[Variable]:
    for field in interface.outputs:
        output = program.output(field.name)
        means = ""
        if output.predicts is not None:
            # a delayed step says what it predicts from its own sample on (decision 0209)
            ahead = output.predicts.ahead - program.late
            means = f"predicts {output.predicts.signal}[t{f'{ahead:+d}' if ahead else ''}]"
        yield Variable(
            name=names.add(field.name),
            kind=VariableKind.OUTPUT,
            place=f"y.{field.identifier}",
            axes=field.axes,
            unit=field.unit,
            range=rounded_range(program.expected_range(field.name), interface.options.dtype),
            doc=one_line(output.doc, means, step_text(program.late) if program.late else ""),
            start=np.zeros(field.size),
        )


def _declared(interface: Interface) -> Iterable[PlainState]:
    for memory in interface.states:
        # memory of layers and registers is no quantity that a user knows
        if isinstance(memory, PlainState) and isinstance(memory.state.origin, Declared):
            yield memory


def _states(interface: Interface, names: VariableNames) -> Iterable[Variable]:
    for memory in _declared(interface):
        state = memory.state
        yield Variable(
            name=names.add(state.name),
            kind=VariableKind.STATE,
            place=f"s.{memory.identifier}",
            axes=state.axes,
            unit=state.unit,
            range=rounded_range(state.range, interface.options.dtype),
            doc=one_line(state.doc, "before the next step"),
            start=np.zeros(math.prod(memory.shape)),
        )


def _parameters(
    program: Program, interface: Interface, weights: Weights, names: VariableNames
) -> Iterable[Variable]:
    dtype = interface.options.dtype
    for field in interface.parameters:
        parameter = program.parameter(field.name)
        values = _as(dtype, weights[field.name]).ravel()
        yield Variable(
            name=names.add(field.name),
            kind=VariableKind.PARAMETER,
            place=f"p.{field.identifier}",
            axes=field.axes,
            unit=field.unit,
            range=_around(rounded_range(_bounds(parameter), dtype), values),
            doc=one_line(parameter.doc),
            start=values,
        )


def _samples(interface: Interface, names: VariableNames) -> Iterable[Variable]:
    dtype = interface.options.dtype
    for field, port in interface.windows:
        signal = port.signal
        yield Variable(
            name=names.add(f"start.{signal.name}"),
            kind=VariableKind.SAMPLES,
            place=f"x0.{field.identifier}",
            axes=field.axes,
            unit=signal.unit,
            range=rounded_range(signal.range, dtype),
            doc=one_line(signal.doc, _samples_text(port)),
            start=_valid(field, signal.range, dtype),
            first_sample=port.first,
        )
    # without `first_sample`: these are values at the first step itself, not samples of a log
    for field, state in interface.supplied:
        yield Variable(
            name=names.add(f"start.{state.name}"),
            kind=VariableKind.SAMPLES,
            place=f"x0.{field.identifier}",
            axes=field.axes,
            unit=state.unit,
            range=rounded_range(state.range, dtype),
            doc=one_line(state.doc, "before the first step"),
            start=_valid(field, state.range, dtype),
        )


def _first_values(
    program: Program, interface: Interface, weights: Weights, names: VariableNames
) -> Iterable[Variable]:
    """One variable for the first value of each declared state whose start reads no recorded
    samples.
    """
    dtype = interface.options.dtype
    free = [m for m in _declared(interface) if m.state.name not in interface.from_record]
    values = _values_at_start(program, [m.state for m in free], weights, dtype)
    for memory in free:
        state = memory.state
        yield Variable(
            name=names.add(f"start.{state.name}"),
            kind=VariableKind.FIRST,
            place=f"{FIRST}.{memory.identifier}",
            axes=state.axes,
            unit=state.unit,
            range=_around(rounded_range(state.range, dtype), values[state.name]),
            doc=one_line(state.doc, "before the first step"),
            start=values[state.name],
        )


def _values_at_start(
    program: Program, states: Sequence[State], weights: Weights, dtype: Dtype
) -> Mapping[str, NDArray[Any]]:
    # no log, no outputs: only the first values are asked for
    alone = replace(program, states=tuple(states), losses=(), outputs=(), expected=())
    found = Interpreter(alone, weights, dtype).start({}, [0])
    return {name: value[0].ravel() for name, value in found.items()}


def rounded_range(range: Range, dtype: Dtype) -> Range:
    """The limits (low, high) rounded to the type in which the C code compares; None for None."""
    if range is None:
        return None
    # a limit of 0.1 is another number in float32: the C compares with that one
    low, high = (float(bound) for bound in _as(dtype, np.array(range)))
    return low, high


def _around(range: Range, values: NDArray[Any]) -> Range:
    """The range if all start values are within it, as FMI requires; otherwise None, for no
    limits.
    """
    if range is None or not ((values >= range[0]) & (values <= range[1])).all():
        return None
    return range


def _bounds(parameter: Parameter) -> Range:
    low = -math.inf if parameter.minimum is None else parameter.minimum
    high = math.inf if parameter.maximum is None else parameter.maximum
    return low, high


def _valid(field: Field, range: Range, dtype: Dtype) -> NDArray[Any]:
    return _as(dtype, np.full(field.size, nearest_to_zero(range, dtype)))


def _as(dtype: Dtype, values: NDArray[Any]) -> NDArray[Any]:
    with np.errstate(over="ignore"):
        return np.asarray(values).astype(dtype)


def _sample(port: Port) -> str:
    if port.first == port.last:
        return "" if port.last == 0 else f"sample t{port.last:+d}"
    return f"samples t to t{port.last:+d}"


def _samples_text(port: Port) -> str:
    begin, end = (f"t0{offset:+d}" if offset else "t0" for offset in (port.first, port.last))
    if port.first == port.last:
        return f"sample {end}, where t0 is the first step"
    return f"samples {begin} to {end}, oldest first, where t0 is the first step"

"""Reads the bounds of an `mpc` section: limits in the unit of their signals, scales, rates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TypeGuard

from compiler.ir.builder import GraphBuilder
from compiler.ir.nodes import needed
from compiler.ir.ops import Constant, ReadSignal, ReadState, Window
from compiler.ir.program import Output, Program, Signal
from compiler.ir.types import Type, describe_axes
from msnn.features.control.elaborate.control_program import (
    ControlSpec,
    bounded,
    limit,
    signals_behind,
    signals_in_step,
)
from msnn.features.control.errors import control as errors
from msnn.features.control.keys import ControlBound, OptimalControl
from msnn.features.control.problem.optimal_control import ControlLimits, Limits, PathLimits
from msnn.features.control.problem.structure import signals_held
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.errors import shapes, units
from spec_schema.expressions.tree import Expression
from spec_schema.units.parser import parse_unit
from spec_schema.units.quantity import Quantity, converted
from spec_schema.units.unit import Unit

_SECOND = parse_unit("s")


def scales_of(section: OptimalControl, program: Program) -> dict[str, float]:
    """The typical size of states and signals by name: half of the interval between their bounds in
    the section, else of their range. Those with neither have no entry.

    A buffer of past samples of a signal has the scale of the signal.
    """
    found: dict[str, float] = {}
    for entry in (*program.signals, *program.states):
        if entry.range is not None:
            low, high = entry.range
            # replaced below where bounds say more closely how far the value moves
            found[entry.name] = (high - low) / 2
        bound = section.bounds.get(entry.name)
        # an end that is a formula of references has no size before the controller runs
        if bound is None or not (_is_number(bound.min) and _is_number(bound.max)):
            continue
        # what does not compare is reported where limits are read
        ends = [converted(end, entry.unit, Findings()) for end in (bound.min, bound.max)]
        if ends[0] is not None and ends[1] is not None and ends[0] < ends[1]:
            found[entry.name] = (ends[1] - ends[0]) / 2
    for state, signal in signals_held(program).items():
        if state not in found and signal in found:
            found[state] = found[signal]
    return found


def control_limits(
    asked: ControlSpec, program: Program, scales: Mapping[str, float], findings: Findings
) -> tuple[Program, tuple[ControlLimits, ...]]:
    """The limits of every control, and the program with an output added for each numeric limit.
    Mistakes are reported.
    """
    found: list[ControlLimits] = []
    for name in asked.controls:
        signal = program.signal(name)
        bound = asked.section.bounds.get(name)
        limits, rate = Limits(minimum=None, maximum=None), None
        if bound is not None:
            type = Type(signal.axes, signal.unit)
            program, limits = _limits(asked, program, name, bound, type, findings)
            rate = _rate(program, bound, signal.unit, findings)
            _check_range(signal, limits, program, bound, findings)
        span = signal.span if bound is None else bound.place.key
        scale = scales.get(name, 1.0)
        found.append(ControlLimits(name=name, limits=limits, rate=rate, scale=scale, span=span))
    return program, tuple(found)


def _check_range(
    signal: Signal, limits: Limits, program: Program, bound: ControlBound, findings: Findings
) -> None:
    """Reports, as a warning, limits of a control that reach beyond the declared range
    of the input.
    """
    if signal.range is None:
        return
    low, high = _number(program, limits.minimum), _number(program, limits.maximum)
    least, most = signal.range
    if (low is not None and low < least) or (high is not None and high > most):
        unit = "" if signal.unit is None else f" {signal.unit.text}"
        ends = (f"{least:g}{unit}", f"{most:g}{unit}")
        findings.report(errors.beyond_range(signal.name, *ends, bound.place.key))


def path_limits(
    asked: ControlSpec, program: Program, scales: Mapping[str, float], findings: Findings
) -> tuple[Program, tuple[PathLimits, ...]]:
    """The limits of states, outputs and equations, and the program with an output added for each
    numeric limit. Mistakes are reported.
    """
    found: list[PathLimits] = []
    for name, bound in asked.section.bounds.items():
        if name in asked.controls:
            continue
        value = program.output(bounded(name))
        type, place = program.step[value.node].type, bound.place.key
        # a limit that no control moves is kept or broken whatever is solved
        if not signals_behind(program, [value.node]) & {*asked.controls}:
            findings.report(errors.not_bounded(name, "which no control moves", place, ()))
            continue
        program, limits = _limits(asked, program, name, bound, type, findings)
        ends = [_number(program, end) for end in (limits.minimum, limits.maximum)]
        # where an end is missing or a formula, the declared range gives the scale
        half = (ends[1] - ends[0]) / 2 if ends[0] is not None and ends[1] is not None else 0.0
        direct = signals_in_step(program, value.node) & {*asked.controls}
        found.append(
            PathLimits(
                name=name,
                value=value.name,
                limits=limits,
                reads_control=bool(direct),
                hard=bound.hard,
                linear=None if bound.soft is None else bound.soft.linear,
                quadratic=None if bound.soft is None else bound.soft.quadratic,
                scale=half if half > 0 else scales.get(name, 1.0),
                span=place,
            )
        )
    return program, tuple(found)


def _limits(
    asked: ControlSpec,
    program: Program,
    name: str,
    bound: ControlBound,
    type: Type,
    findings: Findings,
) -> tuple[Program, Limits]:
    ends: list[str | None] = []
    for key, end in (("min", bound.min), ("max", bound.max)):
        if end is None:
            ends.append(None)
            continue
        if _is_number(end):
            number = converted(end, type.unit, findings)
            if number is None:
                # any number: the report ends the compilation, and the other end is still to be read
                number = 0.0
            # a number is an output too: whoever solves reads each limit in one way
            program = _with_number(program, limit(name, key), number, type.unit)
        else:
            _check_limit(asked, program, name, key, type, findings)
        ends.append(limit(name, key))
    low, high = (_number(program, end) for end in ends)
    # after another mistake an end may be the 0 that stands in its place
    if low is not None and high is not None and low > high and not findings.failed:
        unit = f" {type.unit.text}" if type.unit is not None else ""
        shown = (f"{low:g}{unit}", f"{high:g}{unit}")
        findings.report(errors.reversed_bound(name, *shown, bound.place.key))
    return program, Limits(minimum=ends[0], maximum=ends[1])


def _with_number(program: Program, name: str, number: float, unit: Unit | None) -> Program:
    builder = GraphBuilder(program.step)
    output = Output(name, builder.constant(number, unit=unit))
    return replace(program, step=builder.graph(), outputs=(*program.outputs, output))


def _check_limit(
    asked: ControlSpec, program: Program, name: str, key: str, type: Type, findings: Findings
) -> None:
    """Reports a limit that is a formula unless it only reads references and has the unit and the
    axes of the limited value, or is a scalar. `key` is `min` or `max`.
    """
    output = program.output(limit(name, key))
    place = output.span
    assert place is not None
    graph = program.step
    live = needed(graph, [output.node])
    # a limit is known before the solve: it may read references, nothing that the solve decides
    for op in (node.op for index, node in graph if live[index]):
        match op:
            case ReadSignal(signal=read) if read in asked.section.references:
                pass
            case ReadSignal(signal=read) | ReadState(name=read) | Window(state=read):
                findings.report(errors.limit_of_model(name, key, read, place))
                return
            case _:
                pass
    found = graph[output.node].type
    # a scalar limits every element; dims align by name, so their order says nothing (R3)
    if found.axes and set(found.axes) != set(type.axes):
        wanted, axes = describe_axes(type.axes), describe_axes(found.axes)
        findings.report(shapes.wrong_axes(f"`{key}` of `{name}`", wanted, axes, place))
    if found.unit is not None and type.unit is not None and not found.unit.same_as(type.unit):
        findings.report(
            units.units_differ(
                key, found.unit.text, type.unit.text, place, (), bare=None, factor=None
            )
        )


def _rate(
    program: Program, bound: ControlBound, unit: Unit | None, findings: Findings
) -> float | None:
    """The maximum change of a control per sample, in its unit; None without a rate in the spec,
    which gives it per second.
    """
    if bound.rate is None or program.sample_time is None:
        return None
    per_second = None if unit is None else unit / _SECOND
    number = converted(bound.rate, per_second, findings, is_distance=True)
    # a spec gives it per second, the solver moves once a sample
    return None if number is None else number * program.sample_time


def _is_number(end: Quantity | Expression | None) -> TypeGuard[Quantity]:
    return isinstance(end, Quantity)


def _number(program: Program, end: str | None) -> float | None:
    """The value of the limit that the output `end` computes; None if there is none, it is a
    formula, or elements have different limits.
    """
    if end is None:
        return None
    op = program.step[program.output(end).node].op
    # a limit of an array counts as a number where all elements are alike
    return op.values[0] if isinstance(op, Constant) and len(set(op.values)) == 1 else None

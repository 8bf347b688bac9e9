"""Lists the variables of a controller's FMU: its inputs and the controls that it sets."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from backends.c_language.literals import Dtype
from backends.fmu.variable import (
    Range,
    UnitVariables,
    Variable,
    VariableKind,
    VariableNames,
    member_variable,
    one_line,
    placed,
    residual_variable,
)
from backends.fmu.variables import rounded_range
from compiler.ir.program import Signal
from compiler.ir.types import WINDOW, Axis
from compiler.jacobian.matrices import Member
from msnn.features.control.backend.inputs import SeriesField, input_fields
from msnn.features.control.backend.structure.rows import Row, resting_controls, rows_of
from msnn.features.control.fmu.online_unit import OnlineUnit, valid_numbers
from msnn.features.control.problem.optimal_control import ControlProblem

_MEANINGS = {
    0: "optimal",
    1: "a plan that may be applied, stopped before it was optimal",
    2: "no plan keeps all limits",
    3: "an input is infinite or NaN, or a limit NaN",
    4: "not initialised",
}
_TOLD = {
    "INFEASIBLE": "no plan keeps all limits: the last controls, inside their limits",
    "INPUT_NOT_FINITE": "an input is infinite or NaN, or a limit NaN: the last controls",
}
"""CAPPED is no warning: it is what a fixed number of iterations ends with."""


def controller_unit(problem: ControlProblem, prefix: str, dtype: Dtype) -> OnlineUnit:
    """The FMU of the controller of a problem without parameters; `prefix` is that of
    its C names.
    """
    names = VariableNames()
    rows = rows_of(problem)
    controls = list(_controls(problem, rows.rows, names, dtype))
    found = [
        *_states(problem, names),
        *_known(problem, names, dtype),
        *controls,
        residual_variable(names.add("residual"), "by the scales that the spec declares"),
        *_first(problem, resting_controls(rows, problem.controls.size), names, dtype),
    ]
    return OnlineUnit(
        kind="controller",
        prefix=prefix,
        dtype=dtype,
        members=(f"{prefix}_in_t u;",),
        variables=UnitVariables(
            placed(found), names.add("status"), names.add("time"), names.add("iterations")
        ),
        meanings=_MEANINGS,
        told=_TOLD,
    )


def _states(problem: ControlProblem, names: VariableNames) -> Iterator[Variable]:
    docs = {state.name: state.doc for state in problem.program.states}
    registers = problem.registers
    for member in problem.states.members:
        # shift registers have samples as numbers: oldest first
        origin = registers.get(member.name)
        length = member.axes[-1].size if origin is not None else 1
        ahead = getattr(origin, "ahead", 0)
        yield member_variable(
            member,
            name=names.add(member.name),
            kind=VariableKind.INPUT,
            array="u.x",
            doc=one_line(docs[member.name], "as measured or estimated"),
            start=np.zeros(member.size),
            first_sample=ahead - length,
        )


def _known(problem: ControlProblem, names: VariableNames, dtype: Dtype) -> Iterator[Variable]:
    """Yields the input variables for disturbances and references along the horizon."""
    members = (*problem.disturbances.members, *problem.references.members)
    signals = {signal.name: signal for signal in problem.program.signals}
    for field, member in zip(input_fields(problem), members, strict=True):
        signal = signals.get(member.name)
        # limits rounded to the type that compares with them
        limits = None if signal is None else rounded_range(signal.range, dtype)
        yield Variable(
            name=names.add(field.name),
            kind=VariableKind.INPUT,
            place=f"u.{field.identifier}{'[0]' if field.shape else ''}",
            axes=_axes(field, member),
            unit=member.unit,
            range=limits,
            doc=one_line(_doc(signal), "along the horizon" if field.samples > 1 else "held"),
            start=valid_numbers(limits, field.size, dtype),
        )


def _axes(field: SeriesField, member: Member) -> tuple[Axis, ...]:
    """The axes of a variable with several samples: time first, then the axes of one sample."""
    one = tuple(axis for axis in member.axes if axis.name != WINDOW)
    return (Axis(WINDOW, field.samples), *one) if field.samples > 1 else one


def _controls(
    problem: ControlProblem, rows: tuple[Row, ...], names: VariableNames, dtype: Dtype
) -> Iterator[Variable]:
    signals = _signals(problem)
    moves = rows_of(problem).move
    for member in problem.controls.members:
        own = rows[member.first : member.first + member.size]
        yield member_variable(
            member,
            name=names.add(member.name),
            kind=VariableKind.OUTPUT,
            array="y.u",
            # references may move the limits from sample to sample: then no fixed range is right
            range=None if moves else rounded_range(_limits(own), dtype),
            doc=one_line(_doc(signals.get(member.name)), "of this sample, inside its limits"),
            start=np.zeros(member.size),
        )


def _limits(rows: tuple[Row, ...]) -> Range:
    # of all elements: FMI has one range for an array
    low = min((-np.inf if row.minimum is None else row.minimum for row in rows), default=-np.inf)
    high = max((np.inf if row.maximum is None else row.maximum for row in rows), default=np.inf)
    return float(low), float(high)


def _first(
    problem: ControlProblem, resting: list[float], names: VariableNames, dtype: Dtype
) -> Iterator[Variable]:
    for member in problem.controls.members:
        # what is applied before the first step limits its move, where there are rates
        values = resting[member.first : member.first + member.size]
        yield member_variable(
            member,
            name=names.add(f"start.{member.name}"),
            kind=VariableKind.FIRST,
            array="first",
            doc="the control that is applied before the first step",
            start=np.array(values, dtype),
        )


def _signals(problem: ControlProblem) -> Mapping[str, Signal]:
    return {signal.name: signal for signal in problem.program.signals}


def _doc(signal: Signal | None) -> str:
    return "" if signal is None else signal.doc

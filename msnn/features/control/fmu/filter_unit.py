"""Lists the variables of an estimator's FMU: measurements, inputs and estimates."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from backends.c_language.literals import Dtype
from backends.fmu.variable import (
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
from compiler.ir.types import Type
from msnn.features.control.backend.filter_fields import input_fields
from msnn.features.control.fmu.online_unit import Fill, OnlineUnit, valid_numbers
from msnn.features.control.kalman_filter import KalmanFilter
from msnn.features.control.problem.state_estimation import EstimationProblem

_REFUSED = {3: "an input is infinite or NaN", 4: "a state was never given"}
_REFUSALS = {
    "INPUT_NOT_FINITE": "an input is infinite or NaN: the estimate is as it was",
    "NOT_INITIALISED": "a number of the state was never given: nothing is estimated",
}
_FILTER_MEANINGS = {0: "the estimate is that of the measurements", 2: "diverged", **_REFUSED}
_FILTER_TOLD = {
    "DIVERGED": "something would not have been finite: the estimate is as it was",
    **_REFUSALS,
}
_WINDOW_MEANINGS = {
    0: "the estimate is that of the window",
    1: "the same, stopped before it was optimal",
    2: "the window was not solved, the estimate is that of a filter",
    **_REFUSED,
}
_WINDOW_TOLD = {
    "FELL_BACK": "the window was not solved: the estimate is that of the filter that runs along",
    **_REFUSALS,
}
"""CAPPED is no warning: `residual` tells how far off it is."""


def filter_unit(
    problem: EstimationProblem, weights: Mapping[str, ArrayLike], about: Mapping[str, Any]
) -> OnlineUnit:
    """The FMU of a problem's filter or moving-horizon estimator. `weights` has the physical value
    of each parameter; `about` is the JSON description next to its C code.
    """
    dtype: Dtype = about["dtype"]
    prefix: str = about["prefix"]
    # the numbers that a filter begins with are those of the one in Python
    judge = KalmanFilter(problem, weights)
    names = VariableNames()
    is_window = problem.window is not None
    given = list(_inputs(problem, about["in"], names, dtype))
    found = [
        *given,
        *_measured(problem, about["measured"], names, dtype),
        *_estimated(problem, judge, names),
        *([residual_variable(names.add("residual"), "in deviations")] if is_window else []),
        *_first(problem, judge, names, dtype),
    ]
    # C has no empty struct: without inputs there is no member
    members = [f"{prefix}_in_t u;"] if given else []
    members += [f"{prefix}_measured_t measured;", "uint8_t has_begun;"]
    return OnlineUnit(
        kind="window" if is_window else "filter",
        prefix=prefix,
        dtype=dtype,
        members=members,
        variables=UnitVariables(
            placed(found),
            names.add("status"),
            names.add("time"),
            names.add("iterations") if is_window else None,
        ),
        meanings=_WINDOW_MEANINGS if is_window else _FILTER_MEANINGS,
        told=_WINDOW_TOLD if is_window else _FILTER_TOLD,
        takes_inputs=bool(given),
        fills=tuple(_fills(problem, judge)),
    )


def _inputs(
    problem: EstimationProblem, fields: list[dict[str, Any]], names: VariableNames, dtype: Dtype
) -> Iterator[Variable]:
    """Yields the variables of the inputs that act from the previous sample to this one."""
    for field in fields:
        yield _signal(
            problem,
            field["signal"],
            name=names.add(field["signal"]),
            place=_first_of("u", field),
            doc="from the sample before to this one; the first step reads none",
            dtype=dtype,
        )


def _measured(
    problem: EstimationProblem, fields: list[dict[str, Any]], names: VariableNames, dtype: Dtype
) -> Iterator[Variable]:
    """Yields the variables of the measurements, then those of inputs on which measured outputs
    depend in the same step.
    """
    # `measured` of the description lists both kinds in one array, measurements first: the rest are
    # inputs
    count = len(problem.measured)
    for measurement, field in zip(problem.measured, fields[:count], strict=True):
        output = problem.program.output(measurement.value)
        type = problem.program.step[output.node].type
        yield Variable(
            name=names.add(f"measured.{measurement.signal}"),
            kind=VariableKind.INPUT,
            place=_first_of("measured", field),
            axes=type.axes,
            unit=type.unit,
            range=None,
            doc=one_line(output.doc, "measured at this sample; NaN: it was not"),
            start=np.zeros(type.size),
        )
    for field in fields[count:]:
        yield _signal(
            problem,
            field["signal"],
            # the same input is a variable of `_inputs` too, for the step that ends here: two
            # samples, two names
            name=names.add(f"now.{field['signal']}"),
            place=_first_of("measured", field),
            doc="at this sample, for what is measured depends on it",
            dtype=dtype,
        )


def _signal(
    problem: EstimationProblem, signal: str, *, name: str, place: str, doc: str, dtype: Dtype
) -> Variable:
    member = problem.inputs.member(signal)
    known = next((s for s in problem.program.signals if s.name == signal), None)
    limits = None if known is None else rounded_range(known.range, dtype)
    return Variable(
        name=name,
        kind=VariableKind.INPUT,
        place=place,
        axes=member.axes,
        unit=member.unit,
        range=limits,
        doc=one_line("" if known is None else known.doc, doc),
        start=valid_numbers(limits, member.size, dtype),
    )


def _estimated(
    problem: EstimationProblem, judge: KalmanFilter, names: VariableNames
) -> Iterator[Variable]:
    docs = {p.name: p.doc for p in problem.program.parameters}
    docs |= {s.name: s.doc for s in problem.program.states}
    for member in judge.numbers.members:
        yield member_variable(
            member,
            name=names.add(member.name),
            kind=VariableKind.OUTPUT,
            array="y.x",
            doc=one_line(docs[member.name], "as estimated"),
            start=np.zeros(member.size),
            first_sample=_first_sample(problem, member.name),
        )
    for member in judge.numbers.members:
        yield member_variable(
            member,
            name=names.add(f"std.{member.name}"),
            kind=VariableKind.OUTPUT,
            array="y.std",
            doc=one_line(f"standard deviation of {member.name}"),
            start=np.zeros(member.size),
            first_sample=_first_sample(problem, member.name),
        )
    # innovations of all measurements lie in one array, in the order of the problem
    first = 0
    for measurement in problem.measured:
        type = problem.program.step[problem.program.output(measurement.value).node].type
        yield Variable(
            name=names.add(f"innovation.{measurement.signal}"),
            kind=VariableKind.OUTPUT,
            place=f"y.innovation[{first}]",
            axes=type.axes,
            unit=type.unit,
            range=None,
            doc="measured less expected; NaN where nothing was measured",
            start=np.zeros(type.size),
        )
        first += type.size


def _first(
    problem: EstimationProblem, judge: KalmanFilter, names: VariableNames, dtype: Dtype
) -> Iterator[Variable]:
    """Yields the variables with which an importer can set the initial estimate."""
    for member in problem.states.members:
        values = judge.vector[member.first : member.first + member.size]
        yield member_variable(
            member,
            name=names.add(f"start.{member.name}"),
            kind=VariableKind.FIRST,
            array="first",
            doc=one_line(f"{member.name} before the first step; as the spec says where not set"),
            start=np.where(np.isfinite(values), values, 0.0).astype(dtype),
            first_sample=_first_sample(problem, member.name),
        )


def _fills(problem: EstimationProblem, judge: KalmanFilter) -> Iterator[Fill]:
    """Yields the registers of past inputs without initial value: the first sample fills them, as if
    the input had always been constant.
    """
    registers = {judge.numbers.member(name).first: name for name in problem.registers}
    for field in input_fields(problem, judge.numbers):
        for past in field.pasts:
            yield Fill(
                register=registers[past.first],
                source=f"u.{field.identifier}{'[0]' if field.size != 1 else ''}",
                first=past.first,
                size=past.count * past.length,
                length=past.length,
                window=field.window,
            )


def _first_sample(problem: EstimationProblem, name: str) -> int:
    origin = problem.registers.get(name)
    if origin is None:
        return 0
    # an origin without `ahead` is a history, whose newest sample is the one before the step's
    axes = problem.states.member(name).axes
    # the oldest sample, counted from the step's
    return getattr(origin, "ahead", 0) - (Type(axes).window or 1)


def _first_of(struct: str, field: Mapping[str, Any]) -> str:
    # an array is placed by its first number
    return f"{struct}.{field['name']}{'[0]' if field['shape'] else ''}"

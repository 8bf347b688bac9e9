"""Lays out what a filter is given: fields of its inputs and measurements."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from backends.c_language.comments import comment_text
from backends.ports.identifiers import c_identifier
from compiler.ir.program import History
from compiler.ir.types import Type
from compiler.jacobian.matrices import Vector
from msnn.features.control.problem.state_estimation.problem import EstimationProblem


@dataclass(frozen=True, slots=True)
class InputRegister:
    """A register of past samples that begins with the first sample of its input."""

    first: int
    """Place of its first number in the estimate."""
    count: int
    """Numbers of a sample."""
    length: int
    """Samples that it keeps."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FilterField:
    """A signal in a struct of the filter."""

    name: str
    identifier: str
    comment: str
    first: int
    """Place of its first number among all of its kind."""
    size: int
    window: int = 1
    """Samples that are given, from the newest on; those of a number follow each other."""
    pasts: tuple[InputRegister, ...] = ()
    variance: float = 0.0
    """Of a number of a measurement."""


def input_fields(problem: EstimationProblem, estimated: Vector) -> tuple[FilterField, ...]:
    """The inputs of the model."""
    taken: set[str] = set()
    return tuple(
        FilterField(
            name=member.name,
            identifier=c_identifier(member.name, taken),
            comment=_comment(member.name, member.unit and member.unit.text, member.size),
            first=member.first,
            size=member.size,
            window=Type(member.axes).window or 1,
            pasts=tuple(_pasts(problem, estimated, member.name)),
        )
        for member in problem.inputs.members
    )


def measured_fields(
    problem: EstimationProblem, given: Collection[FilterField], smallest: float
) -> tuple[tuple[FilterField, ...], tuple[FilterField, ...]]:
    """The measurements, and the given inputs that stand beside them in one struct.

    Variances are `smallest` at least, so that none is 0 in the filter's type.
    """
    taken: set[str] = set()
    first = 0
    found: list[FilterField] = []
    for measurement in problem.measured:
        node = problem.program.step[problem.program.output(measurement.value).node]
        unit = node.type.unit
        found.append(
            FilterField(
                name=measurement.signal,
                identifier=c_identifier(measurement.signal, taken),
                comment=_comment(measurement.signal, unit and unit.text, node.type.size),
                first=first,
                size=node.type.size,
                # a variance below the smallest number would be 0, and divide by it
                variance=max(measurement.std**2, smallest),
            )
        )
        first += node.type.size
    beside = [
        FilterField(
            name=field.name,
            identifier=c_identifier(field.name, taken),
            comment=field.comment,
            first=field.first,
            size=field.size,
            window=field.window,
            pasts=field.pasts,
        )
        for field in given
    ]
    return tuple(found), tuple(beside)


def _pasts(problem: EstimationProblem, estimated: Vector, name: str) -> list[InputRegister]:
    found: list[InputRegister] = []
    for register, origin in problem.registers.items():
        if isinstance(origin, History) and origin.source == name:
            member = estimated.member(register)
            length = member.axes[-1].size
            found.append(InputRegister(member.first, member.size // length, length))
    return found


def _comment(name: str, unit: str | None, size: int) -> str:
    numbers = f", {size} numbers" if size > 1 else ""
    return comment_text(name + (f" [{unit}]" if unit else "") + numbers)

"""Defines what FMI shows of a variable, and where the C keeps its numbers."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compiler.ir.types import Axis
from compiler.jacobian.matrices import Member
from spec_schema.units.unit import Unit

Range = tuple[float, float] | None


class VariableKind(Enum):
    """The role of a variable for the importer."""

    INPUT = "an input"
    OUTPUT = "an output of the last step"
    STATE = "a state"
    PARAMETER = "a parameter"
    SAMPLES = "samples that the first states are made of"
    FIRST = "the first value of a state"

    @property
    def is_start(self) -> bool:
        """Whether it can be set before the first step alone."""
        return self in (VariableKind.SAMPLES, VariableKind.FIRST)

    @property
    def is_result(self) -> bool:
        """Whether it cannot be set."""
        return self in (VariableKind.OUTPUT, VariableKind.STATE)


@dataclass(frozen=True, slots=True, kw_only=True)
class Variable:
    """Numbers of one name, in C order; FMI 3.0 knows it by `first`, FMI 2.0 each number by its
    own: `first` and those that follow."""

    name: str
    kind: VariableKind
    place: str
    """The member of the C struct that keeps everything of an instance."""
    axes: tuple[Axis, ...]
    unit: Unit | None
    range: Range
    doc: str
    start: NDArray[Any]
    """In C order, (size,); of results nothing reads it."""
    first: int = 0
    first_sample: int = 0
    """Of the window axis, counted from the sample of the step."""

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(axis.size for axis in self.axes)

    @property
    def size(self) -> int:
        return math.prod(self.shape)


@dataclass(frozen=True, slots=True)
class UnitVariables:
    """All variables, with those that no spec names."""

    all: tuple[Variable, ...]
    status: str
    """The name of the status of the last step."""
    time: str
    iterations: str | None = None
    """The name of how many iterations the last step took; None where it does not iterate."""

    @property
    def status_reference(self) -> int:
        """Behind all numbers."""
        return sum(variable.size for variable in self.all)

    @property
    def time_reference(self) -> int:
        return self.status_reference + 1

    @property
    def iterations_reference(self) -> int:
        return self.status_reference + 2

    def of(self, *kinds: VariableKind) -> tuple[Variable, ...]:
        return tuple(variable for variable in self.all if variable.kind in kinds)


def member_variable(
    member: Member,
    *,
    name: str,
    kind: VariableKind,
    array: str,
    doc: str,
    start: NDArray[Any],
    range: Range = None,
    first_sample: int = 0,
) -> Variable:
    """A member of a vector that the C keeps as one `array`."""
    return Variable(
        name=name,
        kind=kind,
        place=f"{array}[{member.first}]",
        axes=member.axes,
        unit=member.unit,
        range=range,
        doc=doc,
        start=start,
        first_sample=first_sample,
    )


def residual_variable(name: str, scale: str) -> Variable:
    """The variable that tells how far from optimal a solve ended."""
    return Variable(
        name=name,
        kind=VariableKind.OUTPUT,
        place="y.residual",
        axes=(),
        unit=None,
        range=None,
        doc=f"largest error of the optimality conditions, {scale}",
        start=np.zeros(1),
    )


def placed(variables: Iterable[Variable]) -> tuple[Variable, ...]:
    """The same with references: each begins behind the numbers of the one before."""
    found: list[Variable] = []
    # FMI 2.0 knows each number by a reference: arrays take as many as they have
    for variable in variables:
        first = found[-1].first + found[-1].size if found else 0
        found.append(replace(variable, first=first))
    return tuple(found)


def one_line(*facts: str) -> str:
    """One line of text."""
    return "; ".join(text for fact in facts if (text := " ".join(fact.split())))

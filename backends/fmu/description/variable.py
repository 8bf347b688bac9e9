"""Defines the variables of a unit, and where the C code stores them."""

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
        """True if the variable can be set only before the first step."""
        return self in (VariableKind.SAMPLES, VariableKind.FIRST)

    @property
    def is_result(self) -> bool:
        """True if the variable cannot be set."""
        return self in (VariableKind.OUTPUT, VariableKind.STATE)


@dataclass(frozen=True, slots=True, kw_only=True)
class Variable:
    """The elements of one name, in C order.

    FMI 3.0 refers to it by `first`, FMI 2.0 refers to its elements by `first` and the following
    numbers.
    """

    name: str
    kind: VariableKind
    place: str
    """The member of the C struct with all data of an instance."""
    axes: tuple[Axis, ...]
    unit: Unit | None
    range: Range
    doc: str
    start: NDArray[Any]
    """Start values in C order, (size,); unused for results."""
    first: int = 0
    first_sample: int = 0
    """First sample of the window axis, relative to the sample of the step."""

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(axis.size for axis in self.axes)

    @property
    def size(self) -> int:
        return math.prod(self.shape)


@dataclass(frozen=True, slots=True)
class UnitVariables:
    """All variables, including those that do not come from the spec."""

    all: tuple[Variable, ...]
    status: str
    """The name of the variable with the status of the last step."""
    time: str
    iterations: str | None = None
    """The name of the variable with the number of iterations of the last step; None if it does not
    iterate."""

    @property
    def status_reference(self) -> int:
        """The value reference of the status, after all other elements."""
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
    """A member of a vector that the C code stores as one `array`."""
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
    """The variable with the largest violation of the optimality conditions of a solution."""
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
    """The variables with value references; each follows the elements of the previous one."""
    found: list[Variable] = []
    # FMI 2.0 knows each number by a reference: arrays take as many as they have
    for variable in variables:
        first = found[-1].first + found[-1].size if found else 0
        found.append(replace(variable, first=first))
    return tuple(found)


def one_line(*facts: str) -> str:
    """The non-empty texts joined into one line."""
    return "; ".join(text for fact in facts if (text := " ".join(fact.split())))

"""Defines a unit and its variables as FMI shows them, with names by the conventions of FMI."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.c_language.literals import Dtype
from compiler.ir.types import WINDOW, Axis
from compiler.jacobian.matrices import Member
from spec_schema.units.unit import Unit

Range = tuple[float, float] | None


class VariableKind(Enum):
    """The role that a variable has for the importer, the program that simulates the unit."""

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
    """A variable of a unit: a scalar or an array in C order. FMI 3.0 refers to it by the number
    `first`, FMI 2.0 to each of its elements by `first` and the following numbers.
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
    """All variables of a unit: those of the spec in `all`, and the names of those for status, time
    and iterations.
    """

    all: tuple[Variable, ...]
    status: str
    """The name of the variable with the status of the last step."""
    time: str
    iterations: str | None = None
    """The name of the variable with the number of iterations of the last step; None if it does not
    iterate."""

    @property
    def status_reference(self) -> int:
        """The number by which FMI refers to the status: the first after all elements of `all`."""
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
    """A variable for a part (`member`) of a vector that the C code stores in the array `array`. The
    other arguments are the fields of `Variable`.
    """
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
    """The output variable with the largest violation of the optimality conditions by the solution
    of an optimal control problem. `scale` describes its unit.
    """
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
    """The variables in the same order, with their numbers `first`: each has as many numbers as
    elements.
    """
    found: list[Variable] = []
    # FMI 2.0 knows each number by a reference: arrays take as many as they have
    for variable in variables:
        first = found[-1].first + found[-1].size if found else 0
        found.append(replace(variable, first=first))
    return tuple(found)


def one_line(*facts: str) -> str:
    """The non-empty texts joined by `; `, with line ends replaced by blanks."""
    return "; ".join(text for fact in facts if (text := " ".join(fact.split())))


class VariableNames:
    """Makes the names of a unit's variables unique. Names of the spec are added first and stay."""

    def __init__(self) -> None:
        self._taken: set[str] = set()

    def add(self, name: str) -> str:
        """The name, or if an earlier variable has it, the name with `_2`, `_3`, … appended. The
        result is taken from now on.
        """
        found, number = name, 2
        while found in self._taken:
            found, number = f"{name}_{number}", number + 1
        self._taken.add(found)
        return found


def is_structured(names: Collection[str]) -> bool:
    """True if all names consist of ASCII identifiers joined by dots, as FMI's convention
    `structured` requires.
    """
    # the convention that allows dots: `plant.x` is a member there
    return all(part.isascii() and part.isidentifier() for name in names for part in name.split("."))


def element_names(variable: Variable, labels: Mapping[str, Sequence[str]]) -> list[tuple[str, str]]:
    """Name (`W[2,1]`, counted from 1) and description of each element in C order, for FMI 2.0.
    Descriptions include sample times and the `labels` of elements, by name of dimension.
    """
    if not variable.shape:
        return [(variable.name, variable.doc)]
    found: list[tuple[str, str]] = []
    # from 1, as FMI 2.0 writes elements
    for at in np.ndindex(variable.shape):
        index = ",".join(str(i + 1) for i in at)
        where = [
            _where(axis, i, variable, labels) for axis, i in zip(variable.axes, at, strict=True)
        ]
        found.append((f"{variable.name}[{index}]", one_line(variable.doc, *where)))
    return found


def _where(axis: Axis, index: int, variable: Variable, labels: Mapping[str, Sequence[str]]) -> str:
    if axis.name == WINDOW:
        offset = variable.first_sample + index
        return f"t{offset:+d}" if offset else "t"
    named = labels.get(axis.name or "", ())
    return f"{axis.name} {named[index]}" if named else ""


ERROR, WARNING = "logStatusError", "logStatusWarning"
"""Categories of log messages, with FMI's names."""

LOG_CATEGORIES = {ERROR: "what was refused, and why", WARNING: "status bits that a step has set"}

ITERATIONS_DOC = "that the last step took"


@dataclass(frozen=True, slots=True, kw_only=True)
class UnitFacts:
    """The description of a model for the files of a unit, the same for both FMI versions."""

    model: str
    made_by: str
    """The version of msnn, and of the plug-ins that the spec uses."""
    identity: str
    """The version of the model: a hash of C code, weights and options."""
    prefix: str
    """The model identifier, the prefix of functions and files."""
    doc: str
    dtype: Dtype
    sample_time: float | None
    """In seconds; None for a static model, whose steps may have any length."""
    variables: UnitVariables
    labels: Mapping[str, Sequence[str]]
    """Labels of the elements of each dimension, by name of the dimension."""
    depends: Mapping[str, Sequence[Variable]] | None
    """The inputs on which each output depends in the same step; None if there is no Jacobian."""
    status_doc: str
    """The meaning of the status values."""

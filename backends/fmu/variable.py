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


class VariableNames:
    """Unique names; names of the spec have priority."""

    def __init__(self) -> None:
        self._taken: set[str] = set()

    def add(self, name: str) -> str:
        """Returns the name, with an appended number if it is already taken."""
        found, number = name, 2
        while found in self._taken:
            found, number = f"{name}_{number}", number + 1
        self._taken.add(found)
        return found


def is_structured(names: Collection[str]) -> bool:
    """True if all names follow FMI's `structured` convention: ASCII identifiers with dots."""
    # the convention that allows dots: `plant.x` is a member there
    return all(part.isascii() and part.isidentifier() for name in names for part in name.split("."))


def element_names(variable: Variable, labels: Mapping[str, Sequence[str]]) -> list[tuple[str, str]]:
    """Name and description of each element for FMI 2.0, such as `W[2,1]`.

    Descriptions include labels and sample times.
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
    """The description of one model, used by both versions of FMI."""

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

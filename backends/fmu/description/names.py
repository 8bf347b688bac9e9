"""Names variables as FMI wants them: its conventions, and the elements of arrays in FMI 2.0."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from backends.fmu.description.variable import Variable, one_line
from compiler.ir.types import WINDOW, Axis


class VariableNames:
    """Different names; those of the spec come first."""

    def __init__(self) -> None:
        self._taken: set[str] = set()

    def add(self, name: str) -> str:
        """The name, with a number behind it where it is taken."""
        found, number = name, 2
        while found in self._taken:
            found, number = f"{name}_{number}", number + 1
        self._taken.add(found)
        return found


def is_structured(names: Collection[str]) -> bool:
    """Whether names keep to FMI's `structured` convention: identifiers of ASCII with dots."""
    # the convention that allows dots: `plant.x` is a member there
    return all(part.isascii() and part.isidentifier() for name in names for part in name.split("."))


def element_names(variable: Variable, labels: Mapping[str, Sequence[str]]) -> list[tuple[str, str]]:
    """Name and description of each number for FMI 2.0, `W[2,1]`; labels and samples are told."""
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

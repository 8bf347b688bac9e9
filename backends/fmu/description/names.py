"""Names variables by FMI's conventions, including the elements of arrays in FMI 2.0."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from backends.fmu.description.variable import Variable, one_line
from compiler.ir.types import WINDOW, Axis


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

"""Converts names and sizes of a model to names and dimensions of a spec."""

from __future__ import annotations

import re
from collections.abc import Callable

from compiler.ir.scalars import SCALAR_FUNCTIONS
from spec_schema.expressions.language import BUILTINS, LOSS_FUNCTIONS
from spec_schema.names import is_name, normalised, why_reserved

_OTHER = re.compile("[^A-Za-z0-9_Ͱ-Ͽ]+")
_LONGEST = 60


class TakenNames:
    """The names that the spec already uses, and the new name of each name in the file."""

    def __init__(self) -> None:
        # functions of the language and its words: an entry of that name could not be told from them
        self._taken = {*BUILTINS, *LOSS_FUNCTIONS, *SCALAR_FUNCTIONS, "flow", "next", "identity"}
        self._new: dict[tuple[str, str], str] = {}

    def of(self, kind: str, old: str) -> str:
        """The name in the spec of an item of the file, unchanged if possible. Items of different
        `kind`, such as `input` and `array`, may have the same old name.
        """
        key = (kind, old)
        if key not in self._new:
            self._new[key] = self.free(old)
        return self._new[key]

    def free(self, wanted: str) -> str:
        """Reserves and returns a valid name that nothing else has: `wanted` if possible, else with
        a number appended.
        """
        name = legal_name(wanted)
        found, count = name, 1
        while found in self._taken:
            count += 1
            found = f"{name}_{count}"
        self._taken.add(found)
        return found


def legal_name(wanted: str) -> str:
    """A valid name similar to `wanted` that is not reserved by the language."""
    name = _OTHER.sub("_", normalised(wanted)).strip("_")[:_LONGEST].rstrip("_")
    if not is_name(name):
        name = f"n_{name}" if name else "unnamed"
    return f"{name}_" if why_reserved(name) is not None else name


class Dims:
    """The dimensions that the spec declares, one for each size and kind. `free_name` reserves a
    name.
    """

    def __init__(self, free_name: Callable[[str], str]) -> None:
        self._free_name = free_name
        self._names: dict[tuple[str, int], str] = {}
        self._sizes: dict[str, int] = {}
        self._labelled: set[str] = set()

    def of(self, size: int, kind: str = "dim") -> str:
        """The name of the dimension with that size and kind, such as `dim3` or `tap10`; declares it
        if needed.
        """
        key = (kind, size)
        if key not in self._names:
            self._names[key] = self._free_name(f"{kind}{size}")
            self._sizes[self._names[key]] = size
        return self._names[key]

    def label(self, dim: str, index: int) -> str:
        """The label of element `index` of a dimension, which is then declared with labels."""
        self._labelled.add(dim)
        return f"{dim}_{index}"

    def section(self) -> dict[str, int | list[str]]:
        """The section `dims:` of the spec: a size, or a list of labels, by name."""
        return {
            name: [f"{name}_{i}" for i in range(size)] if name in self._labelled else size
            for name, size in self._sizes.items()
        }

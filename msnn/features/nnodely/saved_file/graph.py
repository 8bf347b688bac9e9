"""Reads the relations of a file as a graph, and matches their forms."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from msnn.features.nnodely.saved_file.grammar import File, names_in


@dataclass(frozen=True)
class Graph:
    """The valid relations of a file."""

    file: File

    @cached_property
    def uses(self) -> Mapping[str, int]:
        """How often a name is an operand, an output, or fed back."""
        found: Counter[str] = Counter(self.file.Outputs.values())
        for name in self.file.Relations:
            found.update(self.operands(name))
        for given in self.file.Inputs.values():
            found.update(one for one in (given.connect, given.closed_loop) if one is not None)
        for given in self.file.Minimizers.values():
            # a loss reads as well: what it compares may not vanish into a layer
            found.update((given.A, given.B))
        return found

    def operands(self, name: str) -> list[str]:
        """The operands of a relation; empty for invalid ones."""
        return names_in(self.file.Relations.get(name, ["", []])[1])

    def pair(self, name: str, kind: str) -> tuple[str, str] | None:
        """The two operands of a relation of that kind; None for other kinds."""
        operands = self.operands(name)
        if name in self.file.Relations and self.file.Relations[name][0] == kind:
            return (operands[0], operands[1]) if len(operands) == 2 else None
        return None

    def is_constant(self, name: str, value: float) -> bool:
        """True if a name is a scalar constant."""
        if name not in self.file.Constants:
            return False
        # nnodely writes numbers with zero, one or two brackets
        return self.file.Constants[name].values in (value, [value], [[value]])

    def sample(self, name: str, age: int) -> str | None:
        """The input of which a relation is the sample at that lag; None for others."""
        given = self.file.Relations.get(name)
        # [−1, 0] is the current sample, [−2, −1] the one before
        wanted = ["SamplePart", -1, [-1 - age, -age]]
        if given is None or len(given) != 4 or [given[0], *given[2:]] != wanted:
            return None
        operands = self.operands(name)
        return operands[0] if len(operands) == 1 and operands[0] in self.file.Inputs else None

"""Expressions of a random spec as trees, so that they can be made smaller; and their shapes."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace


@dataclass(frozen=True, slots=True)
class Shape:
    """Named dims, and a window or an unnamed list of so many elements as the last axis."""

    dims: frozenset[str] = frozenset()
    window: int = 0
    listed: int = 0

    def plus(self, dim: str) -> Shape:
        """With one dim more."""
        return replace(self, dims=self.dims | {dim})

    def minus(self, dim: str) -> Shape:
        """Without a dim."""
        return replace(self, dims=self.dims - {dim})

    @property
    def is_sample(self) -> bool:
        """Whether it has neither window nor list."""
        return not self.window and not self.listed


SCALAR = Shape()


@dataclass(frozen=True, slots=True)
class Term:
    """A pattern with `{0}`, `{1}`, … for its operands: `max({0}, {1})`."""

    pattern: str
    operands: tuple[Term, ...] = ()

    def __str__(self) -> str:
        return self.pattern.format(*self.operands)

    def smaller(self) -> Iterator[Term]:
        """Terms with less in them: a part in place of the whole, then the same of every part."""
        if self.operands:
            yield from self.operands
        if self.pattern not in ("0.3", "u"):
            yield Term("0.3")
        # a signal, where a fault does not show in what never changes
        if self.operands:
            yield Term("u")
        for number, operand in enumerate(self.operands):
            for less in operand.smaller():
                operands = (*self.operands[:number], less, *self.operands[number + 1 :])
                yield Term(self.pattern, operands)

    def with_in_place_of(self, name: re.Pattern[str], other: Term) -> Term:
        """With another term wherever a name stands alone."""
        if not self.operands:
            return other if name.fullmatch(self.pattern) else self
        return Term(self.pattern, tuple(o.with_in_place_of(name, other) for o in self.operands))


def leaf(text: str) -> Term:
    """A term without operands; braces in it are meant literally nowhere."""
    return Term(text)

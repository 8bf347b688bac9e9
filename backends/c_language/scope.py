"""Collects a block of C under construction: statements, loops and local names."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import product
from typing import TypeAlias

from backends.c_language import tree as c
from backends.c_language.places import Index, variable
from backends.ports.identifiers import c_identifier

_COUNTERS = ("i", "j", "k", "m", "n", "i5", "i6", "i7")
_ARGUMENTS = ("s", "p", "u", "y", "x0", "status")


@dataclass(frozen=True, slots=True)
class SpecName:
    """A name from the spec, in contrast to a generated name."""

    text: str


LocalName: TypeAlias = str | SpecName


class LocalNames:
    """Names of one function's variables: unique, and never hiding a declaration of a header."""

    def __init__(self, prefix: str, of_spec: Iterable[str] = ()) -> None:
        """Names `of_spec` are reserved for the values of the spec; other names avoid them."""
        self._prefix = prefix.lower()
        self._taken = {*_COUNTERS, *_ARGUMENTS}
        self._numbers: dict[str, int] = {}
        self._kept = {name: self._new(name) for name in dict.fromkeys(of_spec)}

    def fresh(self, name: LocalName) -> str:
        """A new name similar to the given one; a name of the spec is used as is the first time."""
        if isinstance(name, str):
            return self._new(name)
        # once: a second value with that name, such as a row in a loop, gets a number
        return self._kept.pop(name.text, None) or self._new(name.text)

    def reserve(self, name: str) -> None:
        """Reserves exactly this name; called before others are created."""
        of_spec = next((own for own, kept in self._kept.items() if kept == name), None)
        # the argument gets the name; the value of the spec gets another one
        if of_spec is not None:
            del self._kept[of_spec]
            return
        assert name not in self._taken
        self._taken.add(name)

    def _new(self, name: str) -> str:
        # names with the prefix belong to the headers
        if name.lower().startswith(self._prefix):
            name = f"v_{name}"
        return c_identifier(name, self._taken, self._numbers)


class BlockScope:
    """Statements of a block; `loop` creates inner blocks."""

    def __init__(self, names: LocalNames, depth: int = 0, note: str = "") -> None:
        self.statements: list[c.Statement] = []
        self._names = names
        self._depth = depth
        self._note = note

    def fresh(self, name: LocalName) -> str:
        """A name that is not used in the function yet."""
        return self._names.fresh(name)

    def reserve(self, name: str) -> None:
        """Reserves exactly this name."""
        self._names.reserve(name)

    def add(self, statement: c.Statement) -> None:
        self.statements.append(statement)

    def note(self, text: str, about: str = "") -> bool:
        """Adds a comment, unless the previous one was about the same thing; True if added."""
        about = about or text
        if not text or about == self._note:
            return False
        self._note = about
        self.add(c.Comment(text))
        return True

    def constant(
        self, name: LocalName, value: c.Expression, type: c.CType = c.CType.REAL
    ) -> c.Name:
        """Declares a constant with that value."""
        local = self._names.fresh(name)
        self.add(c.Declare(type, local, value, constant=True))
        return c.Name(local)

    def variable(self, name: LocalName, value: c.Expression) -> c.Name:
        """Declares a real variable with that initial value."""
        local = self._names.fresh(name)
        self.add(c.Declare(c.CType.REAL, local, value))
        return c.Name(local)

    def array(self, name: LocalName, size: int, type: c.CType = c.CType.REAL) -> c.Name:
        """Declares an uninitialised array."""
        local = self._names.fresh(name)
        self.add(c.Declare(type, local, size=size))
        return c.Name(local)

    def inner(self) -> BlockScope:
        """A block inside this one."""
        return BlockScope(self._names, self._depth, self._note)

    @contextmanager
    def loop(self, count: int, step: int = 1) -> Generator[tuple[Index, BlockScope]]:
        """A loop over 0, step, … below count: its counter and its body."""
        # named by depth: consecutive loops share a counter, nested ones do not
        counter = _COUNTERS[self._depth]
        inner = BlockScope(self._names, self._depth + 1, self._note)
        yield variable(counter), inner
        self.add(c.Loop(counter, 0, count, tuple(inner.statements), step=step))

    def each(
        self,
        shape: Sequence[int],
        unroll: int,
        body: Callable[[tuple[Index, ...], BlockScope], None],
    ) -> None:
        """Calls `body` with the indices of every element of the shape and the block to write into.

        Up to `unroll` elements each element gets its own statements; more elements are written as
        loops.
        """
        if math.prod(shape) <= unroll:
            for indices in product(*(range(size) for size in shape)):
                body(tuple(Index(index) for index in indices), self)
            return
        self._nest((), tuple(shape), body)

    def _nest(
        self,
        outer: tuple[Index, ...],
        rest: tuple[int, ...],
        body: Callable[[tuple[Index, ...], BlockScope], None],
    ) -> None:
        if not rest:
            body(outer, self)
        # an axis of length 1 needs none of the eight counters
        elif rest[0] == 1:
            self._nest((*outer, Index()), rest[1:], body)
        else:
            with self.loop(rest[0]) as (index, inner):
                inner._nest((*outer, index), rest[1:], body)

    def assign(self, target: c.Expression, value: c.Expression) -> None:
        self.add(c.Assign(target, value))

    def function(self, name: str, result: str, arguments: tuple[c.Argument, ...]) -> c.Function:
        """A static function whose body is this block."""
        body = tuple(self.statements)
        return c.Function(name=name, result=result, arguments=arguments, body=body, static=True)

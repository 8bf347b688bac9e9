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
    """The name of a local variable that the spec gives to the value. Generated names are plain
    strings.
    """

    text: str


LocalName: TypeAlias = str | SpecName


class LocalNames:
    """The names of the local variables of one C function: unique, and different from names of
    headers, which begin with `prefix`.
    """

    def __init__(self, prefix: str, of_spec: Iterable[str] = ()) -> None:
        """The names `of_spec` are kept for values that the spec names so; generated names avoid
        them.
        """
        self._prefix = prefix.lower()
        self._taken = {*_COUNTERS, *_ARGUMENTS}
        self._numbers: dict[str, int] = {}
        self._kept = {name: self._new(name) for name in dict.fromkeys(of_spec)}

    def fresh(self, name: LocalName) -> str:
        """A new C name, as similar as possible to the given one. The first use of a name of the
        spec gets that name itself, if it is a valid one.
        """
        if isinstance(name, str):
            return self._new(name)
        # once: a second value with that name, such as a row in a loop, gets a number
        return self._kept.pop(name.text, None) or self._new(name.text)

    def reserve(self, name: str) -> None:
        """Takes exactly this name, such as that of an argument, so that no variable gets it. It
        must be called before variables are named.
        """
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
    """A block of C under construction: `statements` so far, with methods that add declarations,
    loops and comments. `depth` is the number of loops around it.
    """

    def __init__(self, names: LocalNames, depth: int = 0, note: str = "") -> None:
        self.statements: list[c.Statement] = []
        self._names = names
        self._depth = depth
        self._note = note

    def fresh(self, name: LocalName) -> str:
        """A C name similar to the given one that is not used in the function yet."""
        return self._names.fresh(name)

    def reserve(self, name: str) -> None:
        """Takes exactly this name, so that no local variable of the function gets it."""
        self._names.reserve(name)

    def add(self, statement: c.Statement) -> None:
        self.statements.append(statement)

    def note(self, text: str, about: str = "") -> bool:
        """Adds the comment `text`, unless it is empty or the previous comment was about the same
        thing (`about`, by default the text). Returns True if it was added.
        """
        about = about or text
        if not text or about == self._note:
            return False
        self._note = about
        self.add(c.Comment(text))
        return True

    def constant(
        self, name: LocalName, value: c.Expression, type: c.CType = c.CType.REAL
    ) -> c.Name:
        """Declares a constant with that value and a new name similar to `name`; returns the
        name.
        """
        local = self._names.fresh(name)
        self.add(c.Declare(type, local, value, constant=True))
        return c.Name(local)

    def variable(self, name: LocalName, value: c.Expression) -> c.Name:
        """Declares a real variable with that initial value and a new name similar to `name`;
        returns the name.
        """
        local = self._names.fresh(name)
        self.add(c.Declare(c.CType.REAL, local, value))
        return c.Name(local)

    def array(self, name: LocalName, size: int, type: c.CType = c.CType.REAL) -> c.Name:
        """Declares an uninitialised array of `size` elements with a new name similar to `name`;
        returns the name.
        """
        local = self._names.fresh(name)
        self.add(c.Declare(type, local, size=size))
        return c.Name(local)

    def inner(self) -> BlockScope:
        """A new block inside this one. The caller adds its statements to this block."""
        return BlockScope(self._names, self._depth, self._note)

    @contextmanager
    def loop(self, count: int, step: int = 1) -> Generator[tuple[Index, BlockScope]]:
        """Context manager that adds a loop over 0, step, … below count. It gives the loop's counter
        and the block of its body.
        """
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
        """Calls `body(indices, block)` so that it writes statements for every element of the shape
        into the block. Up to `unroll` elements each get statements of their own; for more, `body`
        is called once inside nested loops.
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
        """A static C function whose body is this block. `result` is its return type as text."""
        body = tuple(self.statements)
        return c.Function(name=name, result=result, arguments=arguments, body=body, static=True)

"""Writes what is done about words outside their range: a local holds those that are used."""

from __future__ import annotations

from backends.c_language.places import Index
from backends.c_language.scope import Scope
from backends.c_language.tree import (
    Binary,
    Convert,
    CType,
    Declare,
    Element,
    Expression,
    If,
    Member,
    Name,
    Statement,
)
from backends.fixed_point.helpers import FixedHelpers
from backends.fixed_point.memories import element
from backends.fixed_point.names import FixedNames
from compiler.fixed_point.integers.program import CheckedInput, WordPort


def word_of(port: WordPort, field: str, at: Index) -> Expression:
    """An element of the local that holds the words of a port."""
    return element(Name(f"w_{field}"), port.axes, at)


def check_window(port: WordPort, field: str, helpers: FixedHelpers, scope: Scope) -> None:
    """Words of a window for `reset`, moved into their range."""
    given = Member("x0", field)
    if not port.axes:
        scope.add(Declare(CType.WORD, f"w_{field}", _limited(given, port, helpers), constant=True))
        return
    scope.add(Declare(CType.WORD, f"w_{field}", size=port.size))
    with scope.loop(port.size) as (along, inner):
        limited = _limited(Element(given, along.expression()), port, helpers)
        inner.assign(word_of(port, field, along), limited)


def check_input(
    entry: CheckedInput, names: FixedNames, report: Statement, helpers: FixedHelpers, scope: Scope
) -> None:
    """Words of an input for `step`: `report` says that one was outside its range."""
    port, field = entry.port, names.inputs[entry.port.name]
    given, local = Member("u", field), f"w_{field}"
    held = names.held.get(port.name)
    if port.axes:
        scope.add(Declare(CType.WORD, local, size=port.size))
        with scope.loop(port.size) as (along, inner):
            word = word_of(port, field, along)
            raw = Element(given, along.expression())
            inner.assign(word, _limited(raw, port, helpers))
            kept = None if held is None else Element(Member("s", held), along.expression())
            _replace(word, raw, kept, report, inner)
        return
    limited = _limited(given, port, helpers)
    scope.add(Declare(CType.WORD, local, limited, constant=held is None))
    _replace(Name(local), given, None if held is None else Member("s", held), report, scope)


def _replace(
    word: Expression, raw: Expression, held: Expression | None, report: Statement, scope: Scope
) -> None:
    """Reports a word that was moved, and takes the last valid one instead where one is held."""
    inner = scope.inner()
    if held is not None:
        inner.assign(word, held)
    inner.add(report)
    scope.add(If(Binary("!=", word, raw), tuple(inner.statements)))
    if held is not None:
        scope.assign(held, word)


def _limited(raw: Expression, port: WordPort, helpers: FixedHelpers) -> Expression:
    return Convert(CType.WORD, helpers.limited(Convert(CType.SUM, raw), port.low, port.high))

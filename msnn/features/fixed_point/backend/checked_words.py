"""Writes the range checks of input words: a local variable holds the words that the step uses."""

from __future__ import annotations

from backends.c_language import tree as c
from backends.c_language.places import Index
from backends.c_language.scope import BlockScope
from msnn.features.fixed_point.backend.helpers import FixedHelpers
from msnn.features.fixed_point.backend.memories import element
from msnn.features.fixed_point.backend.names import FixedNames
from msnn.features.fixed_point.integers.program import CheckedInput, WordPort


def word_of(port: WordPort, field: str, at: Index) -> c.Expression:
    """The element at this index of the local variable with the words of a port."""
    return element(c.Name(f"w_{field}"), port.axes, at)


def check_window(
    port: WordPort, field: str, report: c.Statement, helpers: FixedHelpers, scope: BlockScope
) -> None:
    """Limits the words of a window for `reset` to their range; `report` runs if one was outside."""
    _check(port, c.Member("x0", field), field, None, (report, helpers, scope))


def check_input(
    entry: CheckedInput,
    names: FixedNames,
    report: c.Statement,
    helpers: FixedHelpers,
    scope: BlockScope,
) -> None:
    """Checks the words of an input for `step`; `report` runs if one is out of range."""
    port, field = entry.port, names.inputs[entry.port.name]
    held = names.held.get(port.name)
    kept = None if held is None else c.Member("s", held)
    _check(port, c.Member("u", field), field, kept, (report, helpers, scope))


def _check(
    port: WordPort,
    given: c.Expression,
    field: str,
    held: c.Expression | None,
    writing: tuple[c.Statement, FixedHelpers, BlockScope],
) -> None:
    report, helpers, scope = writing
    local = f"w_{field}"
    if port.axes:
        scope.add(c.Declare(c.CType.WORD, local, size=port.size))
        with scope.loop(port.size) as (along, inner):
            # the local is what the step reads: the caller's struct is const and may be shared by
            # models
            word = word_of(port, field, along)
            raw = c.Element(given, along.expression())
            inner.assign(word, _limited(raw, port, helpers))
            kept = None if held is None else c.Element(held, along.expression())
            _replace(word, raw, kept, report, inner)
        return
    limited = _limited(given, port, helpers)
    scope.add(c.Declare(c.CType.WORD, local, limited, constant=held is None))
    _replace(c.Name(local), given, held, report, scope)


def _replace(
    word: c.Expression,
    raw: c.Expression,
    held: c.Expression | None,
    report: c.Statement,
    scope: BlockScope,
) -> None:
    """Reports a word that was limited. With the policy `hold`, the last valid word replaces it."""
    inner = scope.inner()
    if held is not None:
        inner.assign(word, held)
    inner.add(report)
    scope.add(c.If(c.Binary("!=", word, raw), tuple(inner.statements)))
    if held is not None:
        # in any case: a valid word is what the next step holds, an invalid one was replaced by it
        scope.assign(held, word)


def _limited(raw: c.Expression, port: WordPort, helpers: FixedHelpers) -> c.Expression:
    return c.Convert(
        c.CType.WORD, helpers.limited(c.Convert(c.CType.SUM, raw), port.low, port.high)
    )

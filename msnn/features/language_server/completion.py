"""Completes the text at a position: keys, names, functions, units, words."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Literal, get_args

from compiler.ir.scalars import SIGNATURES
from compiler.lowering.context import Kind
from msnn.features.language_server.cursor import Cursor
from msnn.features.language_server.hover import function_text, name_text
from msnn.features.language_server.knowledge import Known, members
from msnn.features.language_server.positions import Position, TextRange, offset_of, position_of
from msnn.features.language_server.schema_place import SchemaPlace, place_of
from msnn.features.language_server.view import View
from spec_schema.editors.json_schema import key_doc
from spec_schema.expressions.language import BUILTINS, LOSS_FUNCTIONS, NUMBERS, STATE_FUNCTIONS
from spec_schema.fields.entry import OneOf
from spec_schema.fields.formulas import (
    ArrayField,
    ConditionField,
    ExpressionField,
    PredictionField,
)
from spec_schema.fields.leaf import Gathering, declarations
from spec_schema.fields.leaf import members as member_keys
from spec_schema.fields.plain import Reference, SwitchOrReference
from spec_schema.fields.quantities import QuantityField, UnitField
from spec_schema.registry import FUNCTIONS
from spec_schema.units.unit import PREFIXES, UNIT_ROWS

MOST = 200
"""Maximum number of proposals; an editor asks again when more is typed."""

ItemKind = Literal["key", "name", "function", "unit", "word"]

_IN_NAME = re.compile(r"[\w.]")
_IN_KEY = re.compile(r"[\w.-]")
_IN_UNIT = re.compile(r"[^\W\d_]")
_AFTER_NUMBER = re.compile(r"\s*[+-]?[\d.]+(?:[eE][+-]?\d+)?\s+(?P<unit>\S*)\Z")
_CALL = re.compile(r"([\w.]+)\s*\Z")
_KEYWORD_OF_DIMS = re.compile(r"\b(?:over|dim)\s*=\s*\Z")
_LONGEST_NAME = 200
"""Characters before a bracket in which the called name is searched."""
# the note behind the type of an Annotated: what tells one leaf from another
_EXPRESSIONS = tuple(get_args(field)[1] for field in (ExpressionField, ConditionField, ArrayField))
_REFERENCES = tuple(get_args(field)[1] for field in (Reference, SwitchOrReference))
_UNIT_LEAF, _QUANTITY, _PREDICTION = (
    get_args(field)[1] for field in (UnitField, QuantityField, PredictionField)
)
_OF_DIMS = {"dims", "dim", "out", "along", "over"}
_LOGGED = (Kind.INPUT, Kind.TARGET, Kind.STATE)
_CALLED = (Kind.LAYER, Kind.FUNCTION)


@dataclass(frozen=True, slots=True, kw_only=True)
class Item:
    """A proposal: its label, the text that replaces the current word, and for the documentation the
    name or text `about`.
    """

    label: str
    kind: ItemKind
    insert: str
    detail: str = ""
    about: Known | str = ""

    @property
    def doc(self) -> str:
        """Documentation in Markdown; empty if there is none."""
        return name_text(self.about) if isinstance(self.about, Known) else self.about


@dataclass(frozen=True)
class Completion:
    """The proposals at a position, and the range of the text that each would replace. `is_whole` is
    False if there are more than `MOST`.
    """

    items: tuple[Item, ...]
    range: TextRange
    is_whole: bool


def complete(view: View, position: Position) -> Completion | None:
    """The proposals for a position: keys, names, units or words, by the schema of that place. None
    in a comment, and where the schema has no names or fixed words.
    """
    if view.is_comment(position):
        return None
    cursor = view.cursor(position)
    # by the schema, not by the model: it works in a text that does not compile
    place = place_of(cursor.path)
    if place is None:
        return None
    as_key = cursor.is_key and (place.entry is not None or place.is_mapping)
    if as_key:
        return _chosen(_keys(place, view, position), _IN_KEY, cursor, view, position)
    return _values(place, cursor, view, position)


def _values(
    place: SchemaPlace, cursor: Cursor, view: View, position: Position
) -> Completion | None:
    # `0.1 m`: after a number and a blank only a unit can stand
    quantity = _AFTER_NUMBER.match(cursor.before)
    if place.leaf == _UNIT_LEAF or (quantity is not None and _takes_unit(place)):
        return _chosen(_units(), _IN_UNIT, cursor, view, position)
    # formulas before words: a key that takes both, as `init`, is a formula more often
    if place.leaf in _EXPRESSIONS:
        return _chosen(_in_expression(place, cursor, view), _IN_NAME, cursor, view, position)
    if place.leaf == _PREDICTION:
        return _chosen(_names(view, _LOGGED), _IN_NAME, cursor, view, position)
    words = _words(place)
    if words:
        return _chosen(words, _IN_KEY, cursor, view, position)
    if place.leaf in _REFERENCES:
        dims = (Kind.DIMENSION,) if _is_dimension(cursor) else ()
        return _chosen(_names(view, dims), _IN_NAME, cursor, view, position)
    return None


def _is_dimension(cursor: Cursor) -> bool:
    return bool(_OF_DIMS & set(cursor.path[-2:]))


def _takes_unit(place: SchemaPlace) -> bool:
    return place.leaf == _QUANTITY or place.leaf in _EXPRESSIONS


def _chosen(
    items: Iterable[Item],
    character: re.Pattern[str],
    cursor: Cursor,
    view: View,
    position: Position,
) -> Completion:
    """The items that begin with the typed part of the word, in any case; those with the same case
    come first. `character` matches one character of such a word.
    """
    typed = cursor.before[_start_of_word(cursor.before, character) :]
    folded = typed.casefold()
    kept = [item for item in items if item.label.casefold().startswith(folded)]
    # stable: otherwise in the order of the spec
    kept.sort(key=lambda item: not item.label.startswith(typed))
    line, column = offset_of(position, view.source)
    start = position_of(line, column - len(typed), view.source)
    range = TextRange(start, position_of(line, column, view.source))
    # only the part that was typed is replaced; the end of the word stays, as editors expect
    return Completion(tuple(kept[:MOST]), range, len(kept) <= MOST)


def _start_of_word(text: str, character: re.Pattern[str]) -> int:
    """The index at which the longest suffix of `text` begins whose characters all match
    `character`.
    """
    start = len(text)
    while start and character.fullmatch(text[start - 1]):
        start -= 1
    return start


def _keys(place: SchemaPlace, view: View, position: Position) -> Iterator[Item]:
    line, column = offset_of(position, view.source)
    # a key that is changed has its colon already
    has_colon = view.source.line(line + 1)[column:].lstrip().startswith(":")
    if place.entry is None:
        for known in _named_keys(place.gathering, view):
            yield _of_name(known, known.name if has_colon else f"{known.name}: ")
        return
    for key in place.entry.known_keys():
        below = place.below(key)
        opens = not below.leaf or below.is_mapping
        insert = key if has_colon else f"{key}:" if opens else f"{key}: "
        yield Item(
            label=key,
            kind="key",
            insert=insert,
            detail=place.entry.noun,
            about=key_doc(place.entry, key),
        )


def _named_keys(gathering: Gathering | None, view: View) -> Iterator[Known]:
    """The declared names that may be keys here: signals and states, or members of sub-models. None
    where keys are new names. `gathering` is the reader of these keys.
    """
    if gathering is None or gathering.schema is declarations:
        return
    of_parts = gathering.schema is member_keys
    for known in view.names.values():
        if ("." in known.name) == of_parts and (of_parts or known.kind in _LOGGED):
            yield known


def _words(place: SchemaPlace) -> list[Item]:
    entry = place.entry
    if entry is not None and issubclass(entry, OneOf):
        known = entry.known_keys()
        return [
            Item(label=key, kind="word", insert=key, detail=entry.noun, about=key_doc(entry, key))
            for key in known
        ]
    return [Item(label=word, kind="word", insert=word) for word in place.words]


def _units() -> Iterator[Item]:
    for symbol, row in UNIT_ROWS.items():
        yield Item(label=symbol, kind="unit", insert=symbol)
        if row.prefixes:
            for prefix in PREFIXES:
                # rare ones, and `u`, another way to write µ
                if prefix not in ("da", "d", "h", "f", "p", "u"):
                    yield Item(label=f"{prefix}{symbol}", kind="unit", insert=f"{prefix}{symbol}")


def _in_expression(place: SchemaPlace, cursor: Cursor, view: View) -> Iterator[Item]:
    start = _start_of_word(cursor.before, _IN_NAME)
    # `plant.`: members of what stands before the last dot
    base, dot, _ = cursor.before[start:].rpartition(".")
    if dot:
        yield from _members(base, view)
        return
    if _KEYWORD_OF_DIMS.search(cursor.before[:start]) is not None:
        yield from _names(view, (Kind.DIMENSION,))
        return
    yield from _keywords(cursor.before[:start])
    if place.key == "expr" and cursor.path[:1] == ("functions",) and len(cursor.path) > 1:
        function = view.names.get(cursor.path[1])
        for argument in function.arguments if function is not None else ():
            yield Item(label=argument, kind="name", insert=argument, detail="an argument")
    yield from _names(view)
    if cursor.path[:1] == ("losses",):
        for name, signature in LOSS_FUNCTIONS.items():
            yield Item(
                label=name,
                kind="function",
                insert=name,
                detail=signature.wanted,
                about=function_text(name, signature),
            )
    of_plugins = {name: line.signature for name, line in FUNCTIONS.items()}
    for name, signature in (SIGNATURES | of_plugins).items():
        yield Item(
            label=name,
            kind="function",
            insert=name,
            detail=signature.wanted,
            about=function_text(name, signature),
        )
    for name in ("dt", *NUMBERS):
        yield Item(label=name, kind="word", insert=name)
    for name in STATE_FUNCTIONS:
        yield Item(label=name, kind="function", insert=name, detail="of a state")


def _members(base: str, view: View) -> Iterator[Item]:
    for known in members(view.names, base):
        yield _of_name(known, known.name)
    known = view.names.get(base)
    if known is not None and known.kind not in (*_CALLED, Kind.SUBMODEL, Kind.DIMENSION):
        if known.kind in _LOGGED:
            yield Item(
                label=f"{base}.meas", kind="name", insert=f"{base}.meas", detail="the log of it"
            )
        yield Item(
            label=f"{base}.past",
            kind="function",
            insert=f"{base}.past",
            detail="samples that end at t",
        )
        yield Item(
            label=f"{base}.future",
            kind="function",
            insert=f"{base}.future",
            detail="samples after t",
        )


def _keywords(before: str) -> Iterator[Item]:
    """The keywords of the built-in function whose call encloses the end of `before`, the formula up
    to the position; none outside such a call.
    """
    depth = 0
    # backwards to the bracket that is open at the place
    for at in range(len(before) - 1, -1, -1):
        depth += (before[at] in ")]") - (before[at] in "([")
        if depth < 0:
            function = _CALL.search(before[max(0, at - _LONGEST_NAME) : at])
            signature = BUILTINS.get(function[1]) if function is not None else None
            for keyword in signature.keywords if signature is not None else ():
                yield Item(
                    label=f"{keyword}=", kind="word", insert=f"{keyword}=", detail="a keyword"
                )
            return


def _names(view: View, kinds: tuple[Kind, ...] = ()) -> Iterator[Item]:
    for known in view.names.values():
        if not kinds or known.kind in kinds:
            yield _of_name(known, known.name)


def _of_name(known: Known, insert: str) -> Item:
    kind: ItemKind = "function" if known.kind in _CALLED else "name"
    return Item(label=known.name, kind=kind, insert=insert, detail=known.kind.value, about=known)

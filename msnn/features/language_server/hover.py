"""Describes the name or key at a position: type, unit, samples, doc line."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from compiler.ir.scalars import SIGNATURES
from msnn.features.language_server.knowledge import Known
from msnn.features.language_server.positions import Position, TextRange, range_of
from msnn.features.language_server.schema_place import place_of
from msnn.features.language_server.view import View, Word, span_of
from spec_schema.editors.json_schema import key_doc
from spec_schema.expressions.language import LOSS_FUNCTIONS, NUMBERS, Signature
from spec_schema.registry import FUNCTIONS
from spec_schema.units.parser import parse_unit
from spec_schema.units.unit import BASE_SYMBOLS, UnitError

_LANGUAGE = {
    "t": "The index of time: `x[t-1]` is the sample before this one.",
    "dt": "The sample time, in s.",
    "next": "`next(x)`: the value of the state x after the step.",
    "flow": "`flow(x)`: the derivative of the continuous state x.",
    **{name: f"The number {value!r}." for name, value in NUMBERS.items()},
}
_OF_SIGNALS = {
    "meas": "its log, also where the bare name is what the step sees",
    "past": "`.past(1 s)`: its samples of that length that end at t",
    "future": "`.future(1 s)`: its samples of that length from t+1 on",
}


@dataclass(frozen=True)
class Hover:
    """A description in Markdown, and the range of the name or key that it is about."""

    text: str
    range: TextRange


def hover(view: View, position: Position) -> Hover | None:
    """The description of the key, name, function or unit at a position; None if there is none."""
    word = view.word(position)
    if word is None or view.is_comment(position):
        return None
    cursor = view.cursor(position)
    said = _of_key(cursor.path, word, view) if cursor.is_key else _of_value(cursor.path, word, view)
    if not said:
        return None
    return Hover(said, range_of(span_of(word.heading, view.source), view.source))


def _of_key(path: tuple[str, ...], word: Word, view: View) -> str | None:
    place = place_of(path)
    if place is None:
        return None
    if place.is_mapping:
        return _of_name(word.text, view)
    if place.entry is None or word.text not in place.entry.known_keys():
        # a line that only starts a value: `expr:` above, the formula here
        return _of_value(path, word, view)
    doc = key_doc(place.entry, word.text)
    return "\n\n".join([f"**{word.text}** of {place.entry.noun}", doc]).strip()


def _of_value(path: tuple[str, ...], word: Word, view: View) -> str | None:
    place = place_of(path)
    # a place that the schema does not know has no names
    if place is None or (place.leaf is None and place.entry is None):
        return None
    if place.key == "unit":
        return unit_text(word.text)
    if place.key == "doc":
        return None
    return _of_name(word.text, view) or _of_language(word.text)


def _of_name(name: str, view: View) -> str | None:
    known = view.names.get(name)
    if known is not None:
        # what never compiled has no type to show; its text is all that is known
        declared = view.declaration(known) if known.is_new else ""
        return name_text(known) + (f"\n\n```yaml\n{declared}\n```" if declared else "")
    base, _, member = name.rpartition(".")
    if base in view.names and member in _OF_SIGNALS:
        return f"**{name}**: {_OF_SIGNALS[member]}"
    return None


def name_text(known: Known) -> str:
    """A description of a name of the model, in Markdown: kind, type, unit, samples that are read,
    doc.
    """
    return "\n\n".join([f"**{known.name}**, {known.kind.value}", *_facts(known)])


def _facts(known: Known) -> Iterator[str]:
    if known.arguments:
        yield f"`{known.name}({', '.join(known.arguments)})`"
    if known.shape is not None:
        unit = f", unit `{known.unit}`" if known.unit is not None else ""
        yield f"type `{known.shape}`{unit}"
    if known.reads is not None:
        yield f"read at {known.reads}"
    if known.doc:
        yield known.doc


def _of_language(name: str) -> str | None:
    signature = SIGNATURES.get(name) or LOSS_FUNCTIONS.get(name)
    if signature is None and name in FUNCTIONS:
        signature = FUNCTIONS[name].signature
    if signature is not None:
        return function_text(name, signature)
    return f"**{name}**\n\n{_LANGUAGE[name]}" if name in _LANGUAGE else None


def function_text(name: str, signature: Signature) -> str:
    """A description of a function of the language, in Markdown."""
    keywords = "".join(f", `{keyword}=`" for keyword in signature.keywords)
    return f"**{name}**, {signature.wanted}{keywords}\n\n{signature.doc}"


def unit_text(text: str) -> str | None:
    """A unit in SI base units, such as `**km** = 1000 m`; None if the text is no unit."""
    try:
        unit = parse_unit(text)
    except UnitError:
        return None
    powers = zip(BASE_SYMBOLS, unit.exponents, strict=True)
    base = " ".join(s if power == 1 else f"{s}^{power}" for s, power in powers if power)
    offset = f" + {unit.offset:g}" if unit.offset else ""
    return f"**{text}** = {unit.scale:g} {base}{offset}".rstrip()

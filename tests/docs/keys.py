"""Every key of a spec, from the schema."""

from __future__ import annotations

from collections.abc import Mapping
from inspect import isclass
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic.fields import FieldInfo

from spec_schema.editors.json_schema import key_doc
from spec_schema.expressions.tree import Duration, Expression, Samples
from spec_schema.fields.entry import Entry, LateEntry, OneOf, kinds_of, kinds_within
from spec_schema.fields.formulas import Prediction
from spec_schema.fields.leaf import Choice, Located
from spec_schema.sections.data import Blocks, ColumnName, Fraction
from spec_schema.sections.optimizers import OptionValue
from spec_schema.sections.spec import Spec
from spec_schema.sections.submodels import Freeze
from spec_schema.sections.training import Curriculum
from spec_schema.sections.values import Dimension
from spec_schema.units.quantity import Quantity, Range
from spec_schema.units.unit import Unit
from tests.docs.markdown import apart, paragraph, prose, table, wrapped

_WORDS: Mapping[Any, str] = {
    Expression: "expression",
    (Samples | Duration): "samples or duration",
    Duration: "duration",
    Located[OptionValue]: "number, word, switch or list",
    Located[str]: "name",
    str: "text",
    bool: "`true` or `false`",
    int: "whole number",
    float: "number",
    Located[float]: "number",
    Quantity: "quantity",
    Located[Unit]: "unit",
    Range: "`[low, high]`, quantities",
    ColumnName: "column name or index",
    Prediction: "`signal[t+k]`",
    Dimension: "size or list of labels",
    Fraction: "fraction",
    Curriculum: "`{epoch: horizon, …}`",
    Blocks: "list of block numbers",
}


def keys() -> str:
    """The spec, then every mapping in it in the order of first mention."""
    return apart(*(_section(entry) for entry in kinds_within(Spec)))


def known_keys(entry: type[Entry]) -> tuple[str, ...]:
    """Those that this version reads."""
    return tuple(_fields(entry))


def options(entry: type[Entry]) -> str:
    """The keys of an entry, their defaults and what they are for."""
    rows = [(f"`{k}`", _default(f), key_doc(entry, k)) for k, f in _fields(entry).items()]
    return table(("option", "default", ""), rows)


def _fields(entry: type[Entry]) -> dict[str, FieldInfo]:
    fields = entry.model_fields.items()
    return {field.alias or name: field for name, field in fields if name != "place"}


def _section(entry: type[Entry]) -> str:
    parts = [f"## {_title(entry)}", prose(entry.__doc__)]
    if entry.shorthand:
        parts.append(f"A lone value is its `{entry.shorthand}`.")
    is_variant = issubclass(entry, OneOf)
    fields = _fields(entry).items()
    if is_variant:
        variants = [(f"`{k}`", _kind(f), key_doc(entry, k)) for k, f in fields]
        parts.append(table(("variant", "value", ""), variants))
    elif fields:
        rows = [
            (f"`{key}`", _kind(field), _default(field), key_doc(entry, key))
            for key, field in fields
        ]
        parts.append(table(("key", "value", "default", ""), rows))
    else:
        parts.append("No keys.")
    if entry.later:
        reserved = ", ".join(f"`{key}`" for key in sorted(entry.later))
        parts.append(wrapped(f"Reserved, not in this version: {reserved}."))
    return apart(*parts)


def _title(entry: type[Entry]) -> str:
    return entry.noun.removeprefix("a ").removeprefix("an ").removeprefix("the ")


def link(entry: type[Entry], page: str = "") -> str:
    """A link to the section of an entry."""
    title = _title(entry)
    return f"[{title}]({page}#{title.lower().replace(' ', '-')})"


def _kind(field: FieldInfo) -> str:
    return _said(field.annotation)


def _said(annotation: Any) -> str:
    if annotation in _WORDS:
        return _WORDS[annotation]
    if isclass(annotation) and issubclass(annotation, Entry):
        return link(annotation)
    origin, args = get_origin(annotation), get_args(annotation)
    if isinstance(annotation, LateEntry):
        return _said(annotation.kind)
    if origin is Annotated:
        is_late = isinstance(args[1], LateEntry)
        return _said(args[1] if is_late else args[0])
    if origin in (Located, Choice):
        return _said(args[0])
    if origin is Literal:
        return " or ".join(f"`{value}`" for value in args)
    if origin in (Union, UnionType):
        return _said_union(args)
    if origin is tuple:
        of = "list, each" if kinds_of(args[0]) else "one or a list of"
        return f"{of}: {_said(args[0])}"
    if origin is None:
        # a type of the schema's own: its docstring begins with how it is written, between backticks
        written, of_what, _ = paragraph(annotation.__doc__).partition("`: ")
        assert of_what, f"begin the docstring of {annotation.__name__} with how it is written"
        return f"{written}`"
    assert issubclass(origin, Mapping), annotation
    return f"names, each with: {_said(args[1])}"


def _said_union(members: tuple[Any, ...]) -> str:
    """The members in words; those of an expression or a length are one word together."""
    left = [member for member in members if member is not NoneType]
    words: list[str] = []
    for whole in (Expression, Samples | Duration):
        parts = get_args(whole)
        if set(parts) <= set(left):
            words.append(_WORDS[whole])
            left = [member for member in left if member not in parts]
    return " or ".join([*words, *(_said(member) for member in left)])


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    default = field.get_default(call_default_factory=True)
    match default:
        case None | () | {}:
            return ""
        case Freeze(patterns=()):
            return "`none`"
        case bool():
            return f"`{str(default).lower()}`"
        case float():
            return f"`{default:g}`"
        case _:
            return f"`{default}`"

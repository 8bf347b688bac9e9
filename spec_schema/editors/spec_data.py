"""Turns a spec into plain values of its canonical form: shorthands expanded, defaults filled in."""

from collections.abc import Mapping
from typing import Any, cast

from spec_schema.expressions import tree
from spec_schema.expressions.moments import Date
from spec_schema.expressions.tree import expression_text, length_text, number_text
from spec_schema.fields.entry import Entry, OneOf
from spec_schema.fields.formulas import Prediction
from spec_schema.fields.leaf import Located, Spelled
from spec_schema.sections.data import Blocks, ColumnName, DateRange, Fraction, TimeRange
from spec_schema.sections.layers import CustomMembership, Fuzzify
from spec_schema.sections.spec import Spec
from spec_schema.sections.submodels import Freeze
from spec_schema.sections.training import Curriculum
from spec_schema.sections.values import Dimension
from spec_schema.units.quantity import Quantity, Range
from spec_schema.units.unit import Unit


def spec_data(spec: Spec) -> dict[str, Any]:
    """The spec as mappings, lists, texts, numbers and booleans; as YAML or JSON they give an equal
    spec.

    Keys are in the order of the grammar; empty values are omitted.
    """
    return entry_data(spec)


def entry_data(entry: Entry) -> dict[str, Any]:
    """An entry of a spec as mappings, lists, texts, numbers and booleans, like `spec_data`."""
    values: dict[str, Any] = {}
    for name, field in type(entry).model_fields.items():
        value = getattr(entry, name)
        absent = value is None or (isinstance(value, tuple | Mapping) and not value)
        if isinstance(entry, Fuzzify) and entry.over and name not in entry.model_fields_set:
            # a grid takes its sets from others: not even the defaults of its own may be given
            absent = True
        if name != "place" and not absent:
            values[field.alias or name] = _plain(value)
    if isinstance(entry, OneOf) and list(values) == ["value"]:
        return values["value"]
    return values


def _plain(value: Any) -> Any:
    match value:
        case None | bool() | int() | str():
            return value
        case float():
            # `1` and not `1.0`: people read it, and some keys take integers alone
            return int(value) if value.is_integer() and abs(value) < _EXACT else value
        case Entry():
            return entry_data(value)
        case Freeze(patterns=patterns):
            listed = [pattern.value for pattern in patterns]
            return "all" if listed == ["*"] else listed or "none"
        case Spelled():
            return _plain(value.spelling)
        case Located():
            return _plain(cast("Located[Any]", value).value)
        case tree.Number(value=number):
            return _plain(number)
        case Unit(text=text):
            return text
        case Quantity(value=number, unit=unit):
            return _plain(number) if unit is None else f"{number_text(number)} {unit.text}"
        case Range(low=low, high=high):
            return [_plain(low), _plain(high)]
        case tree.Samples(count=count):
            return count
        case tree.Duration():
            return length_text(value)
        case Prediction(signal=signal, ahead=ahead):
            return f"{signal.value}[t+{length_text(ahead)}]"
        case Dimension(size=size, labels=labels):
            return list(labels) or size
        case ColumnName(column=column):
            return column
        case Fraction(value=share):
            return _plain(share)
        case Blocks(numbers=numbers):
            return list(numbers)
        case TimeRange(start=start, stop=stop):
            return [f"{number_text(time)} s" for time in (start, stop)]
        case DateRange(start=start, stop=stop):
            return [start.text, stop.text]
        case Date(text=text):
            return text
        case Curriculum(lessons=lessons):
            return {str(lesson.until): _plain(lesson.horizon) for lesson in lessons}
        case CustomMembership(function=function):
            return {"function": function.value}
        case tuple():
            return [_plain(item) for item in cast("tuple[Any, ...]", value)]
        case Mapping():
            table = cast("Mapping[str, Any]", value)
            return {name: _plain(item) for name, item in table.items()}
        case _:
            assert isinstance(value, _EXPRESSIONS), f"{type(value)} has no text"
            return expression_text(cast("tree.Expression", value))


_EXACT = 2**53
_EXPRESSIONS = (
    tree.Binary,
    tree.Call,
    tree.Compare,
    tree.Future,
    tree.ListLiteral,
    tree.Member,
    tree.Name,
    tree.Negate,
    tree.Past,
    tree.Window,
)

"""Leaf types of the schema: text, names, numbers, switches, choices and lists of them."""

import math
import re
from collections.abc import Callable, Mapping
from typing import Annotated, Any, Literal, TypeAlias, TypeVar

from pydantic import ValidationInfo

from spec_schema.diagnostics.diagnostic import Diagnostic, Findings
from spec_schema.diagnostics.suggest import with_decimal_point
from spec_schema.errors import schema as errors
from spec_schema.fields.entry import RefusedError, findings_of
from spec_schema.fields.leaf import (
    NEW_NAME,
    REFERENCE,
    Choice,
    Gathering,
    JsonSchema,
    LeafField,
    Located,
    list_of,
    one_or_many,
)
from spec_schema.names import is_name, normalised, why_reserved
from spec_schema.yaml_tree.nodes import Listing, Node, Scalar, Table, kind, with_key

_LARGEST = 2**31


def no_number(wanted: str, found: Scalar) -> Diagnostic:
    """E0204 for a scalar that is no number, or no integer where one is `wanted`."""
    # what is in quotes is text to YAML
    said = kind(found)
    number = with_decimal_point(found.text) or found.text.strip()
    if found.quoted and _number(number) is not None:
        repair = "remove the quotes" if number == found.text.strip() else f"write `{number}`"
        return errors.wrong_kind(wanted, said, found.span, repair, number)
    meant = None if found.quoted else _meant(found.text, is_integer=wanted == "an integer")
    repair = None if meant is None else f"write `{meant}`"
    # YAML takes `5#mm` for text: a comment needs a blank before it
    if meant is not None and "#" in meant:
        repair = f"{repair}: a comment begins with a blank and `#`"
    return errors.wrong_kind(wanted, said, found.span, repair, meant)


def _meant(text: str, *, is_integer: bool) -> str | None:
    """The number that a text probably means: `1000` for `1_000`, `1000;` or `1e3`, `0.01` for `1 %`
    or `0,01`.
    """
    number, mark, comment = text.partition("#")
    if mark and _number(number) is not None:
        return f"{number} #{comment}"
    # digits grouped by underscores, and what ends a line elsewhere
    plain = re.sub(r"(?<=\d)_(?=\d)", "", text).rstrip(";, ")
    plain = with_decimal_point(plain) or plain
    # a share is written as a number here: `%` is a unit, of quantities alone
    percent = re.fullmatch(r"([\d.]+)\s*%", plain)
    value = _number(plain if percent is None else percent[1])
    if value is None:
        return None
    if percent is not None:
        return None if is_integer else f"{value / 100:g}"
    if not is_integer:
        return plain
    # `1e3` is a float to YAML 1.2, and means an integer here
    return f"{int(value)}" if value.is_integer() and abs(value) < _LARGEST else None


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


_OLD_BOOLEANS = {"yes", "no", "on", "off", "y", "n"}
Item = TypeVar("Item")
LARGEST_COUNT = 2**31 - 1


def reads(reader: Callable[[Node, Findings], Any], schema: JsonSchema) -> LeafField:
    """A pydantic annotation from a function that reads a node; `schema` is the JSON Schema for
    editors.
    """

    def validate(node: Node, info: ValidationInfo) -> Any:
        return reader(node, findings_of(info))

    return LeafField(validate, schema=schema)


def scalar(node: Node, findings: Findings, wanted: str) -> Scalar:
    """The node, if it is a non-empty scalar; reports an error and raises RefusedError for others.

    `wanted` are the words of the message for what is expected.
    """
    if isinstance(node, Scalar) and not node.is_empty:
        return node
    if isinstance(node, Scalar):
        findings.report(errors.empty_value(wanted, node.key or node.span))
    else:
        findings.report(errors.wrong_kind(wanted, kind(node), node.span))
    raise RefusedError


def _read_text(node: Node, findings: Findings) -> str:
    return scalar(node, findings, "text").text


def _read_located_text(node: Node, findings: Findings) -> Located[str]:
    found = scalar(node, findings, "text")
    if not found.text.strip():
        findings.report(errors.empty_value("text", found.span))
        raise RefusedError
    return Located(found.text, found.span, found.key)


def _read_new_name(node: Node, findings: Findings) -> Located[str]:
    name = _read_reference(node, findings)
    reason = why_reserved(name.value)
    if reason is None and "." not in name.value:
        return name
    if reason is not None:
        findings.report(errors.reserved_name(name.value, name.span, reason))
    else:
        findings.report(errors.malformed_name(name.value, name.span))
    raise RefusedError


def _read_reference(node: Node, findings: Findings) -> Located[str]:
    found = scalar(node, findings, "a name")
    # each part of a name with dots is a name
    if not all(is_name(part) for part in found.text.split(".")):
        findings.report(errors.malformed_name(found.text, found.span))
        raise RefusedError
    # µ and Ω have two code points each: spelled either way it is one name
    return Located(normalised(found.text), found.span, found.key)


def _read_switch(node: Node, findings: Findings, wanted: str = "true or false") -> bool:
    # by the value, not the text: YAML has already said what is a switch
    found = scalar(node, findings, wanted)
    if isinstance(found.value, bool):
        return found.value
    # YAML 1.1 read `yes` and `on` as true: they are text here, and refused with what to write
    if found.text.lower() in _OLD_BOOLEANS:
        findings.report(errors.old_boolean(found.text, found.span))
    else:
        meant = {"1": "true", "0": "false"}.get(found.text)
        repair = f"write `{meant}`" if meant else None
        findings.report(errors.wrong_kind(wanted, kind(found), found.span, repair, meant))
    raise RefusedError


def _read_switch_or_reference(node: Node, findings: Findings) -> bool | Located[str]:
    text = node.value if isinstance(node, Scalar) else None
    if isinstance(text, str) and text.lower() not in _OLD_BOOLEANS:
        return _read_reference(node, findings)
    return _read_switch(node, findings, "true, false or the name of a parameter")


def read_number(node: Node, findings: Findings) -> float:
    """The finite number that a node writes; reports an error and raises RefusedError for others."""
    found = scalar(node, findings, "a number")
    value = found.value
    # `True` is an integer to Python, and a switch to YAML
    if isinstance(value, bool) or not isinstance(value, int | float):
        findings.report(no_number("a number", found))
        raise RefusedError
    if not math.isfinite(value):
        findings.report(errors.out_of_range(found.text, found.span, "finite"))
        raise RefusedError
    return float(value)


def number(
    above: float = -math.inf,
    least: float = -math.inf,
    most: float = math.inf,
    below: float = math.inf,
) -> LeafField:
    """Validates a number with above < number < below, least ≤ number ≤ most."""
    # the words of the message and the keywords of the schema are made of the same four numbers
    limits = [
        f"above {above:g}" if above > -math.inf else "",
        f"at least {least:g}" if least > -math.inf else "",
        f"at most {most:g}" if most < math.inf else "",
        f"below {below:g}" if below < math.inf else "",
    ]
    wanted = " and ".join(limit for limit in limits if limit)

    def read(node: Node, findings: Findings) -> float:
        value = read_number(node, findings)
        if not (above < value < below and least <= value <= most):
            findings.report(errors.out_of_range(f"{value:g}", node.span, wanted))
            raise RefusedError
        return value

    limits_of_schema = {
        "exclusiveMinimum": above,
        "minimum": least,
        "maximum": most,
        "exclusiveMaximum": below,
    }
    # JSON has no infinity: limits that are none are left out
    finite = {key: limit for key, limit in limits_of_schema.items() if math.isfinite(limit)}
    return reads(read, {"type": "number", **finite})


def read_count(node: Node, findings: Findings, least: int, most: int = LARGEST_COUNT) -> int:
    """An integer from `least` to `most`."""
    found = scalar(node, findings, "an integer")
    value = found.value
    if isinstance(value, bool) or not isinstance(value, int):
        findings.report(no_number("an integer", found))
        raise RefusedError
    if not least <= value <= most:
        wanted = f"at least {least}" if value < least else f"at most {most}"
        findings.report(errors.out_of_range(found.text[:40], found.span, wanted))
        raise RefusedError
    return value


def _read_weight(node: Node, findings: Findings) -> Located[float]:
    value = read_number(node, findings)
    if value < 0:
        findings.report(errors.out_of_range(f"{value:g}", node.span, "at least 0"))
        raise RefusedError
    return Located(value, node.span, node.key)


def _read_character(node: Node, findings: Findings) -> str:
    found = scalar(node, findings, "one character")
    # counted in code points: what looks like one character may be several
    if len(found.text) != 1:
        findings.report(errors.wrong_kind("one character", "several", found.span))
        raise RefusedError
    return found.text


def _read_language_version(node: Node, findings: Findings) -> int:
    found = scalar(node, findings, "the language version 1")
    # True == 1 == 1.0 in Python
    if found.value != 1 or isinstance(found.value, bool | float):
        findings.report(errors.unknown_language(found.text[:40], found.span))
        raise RefusedError
    return 1


def count(least: int, most: int = LARGEST_COUNT) -> LeafField:
    """Validates an integer from `least` to `most`."""
    schema = {"type": "integer", "minimum": least, "maximum": most}
    return reads(lambda node, findings: read_count(node, findings, least, most), schema)


def choice(*now: str, elsewhere: Mapping[str, str] | None = None) -> LeafField:
    """A pydantic annotation for one of the words; `elsewhere` maps words of other tools to them."""

    def read(node: Node, findings: Findings) -> str:
        found = scalar(node, findings, f"one of {', '.join(now)}")
        if found.text in now:
            return found.text
        meant = None if elsewhere is None else elsewhere.get(found.text.casefold())
        findings.report(errors.unknown_choice(found.text[:60], found.span, now, meant))
        raise RefusedError

    return reads(read, {"type": "string", "enum": list(now)})


def located_choice(*now: str) -> LeafField:
    """A pydantic annotation for one of the words, with its place in the file."""
    chosen = choice(*now)

    def validate(node: Node, info: ValidationInfo) -> Choice[str]:
        return Choice(chosen.read(node, info), node.span, node.key)

    return LeafField(validate, schema=chosen.schema)


def read_items(node: Node, info: ValidationInfo) -> tuple[Node, ...]:
    """The nodes of a list; a single value counts as a list of one."""
    # a single value stands for a list of one, as people write it
    if isinstance(node, Listing):
        return tuple(with_key(item, item.span) for item in node.items)
    if isinstance(node, Table) or node.is_empty:
        findings_of(info).report(errors.wrong_kind("a list", kind(node), node.key or node.span))
        raise RefusedError
    return (node,)


def read_different_items(node: Node, info: ValidationInfo) -> tuple[Node, ...]:
    """The nodes of a list of distinct texts."""
    items = read_items(node, info)
    seen: dict[str, Scalar] = {}
    for item in items:
        # by text: `1` and `1.0` are two items
        first = seen.setdefault(item.text, item) if isinstance(item, Scalar) else item
        if first is not item and isinstance(item, Scalar):
            is_dim = info.field_name == "dims"
            report = errors.repeated_item(item.text, item.span, first.span, is_dim=is_dim)
            findings_of(info).report(report)
    return items


def read_entries(node: Node, info: ValidationInfo) -> tuple[Node, ...]:
    """The nodes of a list of mappings; reports others."""
    if isinstance(node, Listing):
        return tuple(with_key(item, _key_of(item)) for item in node.items)
    repair = "start each entry with `- `"
    found = kind(node)
    findings_of(info).report(errors.wrong_kind("a list", found, node.key or node.span, repair))
    raise RefusedError


def _key_of(node: Node) -> Any:
    return next(iter(node.keys.values()), node.span) if isinstance(node, Table) else node.span


_SCALAR = {"type": ["string", "number", "boolean"]}

Text: TypeAlias = Annotated[str, reads(_read_text, _SCALAR)]
LocatedText: TypeAlias = Annotated[Located[str], reads(_read_located_text, _SCALAR)]
NewName: TypeAlias = Annotated[
    Located[str], reads(_read_new_name, {"type": "string", "pattern": NEW_NAME})
]
Reference: TypeAlias = Annotated[
    Located[str], reads(_read_reference, {"type": "string", "pattern": REFERENCE})
]
Switch: TypeAlias = Annotated[bool, reads(_read_switch, {"type": "boolean"})]
SwitchOrReference: TypeAlias = Annotated[
    bool | Located[str],
    reads(_read_switch_or_reference, {"type": ["boolean", "string"], "pattern": REFERENCE}),
]
Character: TypeAlias = Annotated[
    str, reads(_read_character, {"type": ["string", "integer"], "minLength": 1, "maxLength": 1})
]
LanguageVersion: TypeAlias = Annotated[
    int, reads(_read_language_version, {"type": "integer", "enum": [1]})
]
Weight: TypeAlias = Annotated[Located[float], reads(_read_weight, {"type": "number", "minimum": 0})]
PositiveNumber: TypeAlias = Annotated[float, number(above=0.0)]
NonNegativeNumber: TypeAlias = Annotated[float, number(least=0.0)]
PositiveCount: TypeAlias = Annotated[int, count(1)]
NonNegativeCount: TypeAlias = Annotated[int, count(0)]
Dtype: TypeAlias = Annotated[Literal["float32", "float64"], choice("float32", "float64")]
ManyOf: TypeAlias = Annotated[tuple[Item, ...], Gathering(read_items, schema=one_or_many)]
EntriesOf: TypeAlias = Annotated[tuple[Item, ...], Gathering(read_entries, schema=list_of)]
DifferentOf: TypeAlias = Annotated[
    tuple[Item, ...], Gathering(read_different_items, schema=one_or_many)
]
References: TypeAlias = DifferentOf[Reference]

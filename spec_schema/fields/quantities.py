"""Leaf types of the schema that have units, and places in a record: a row, a time, a date."""

import math
import re
from typing import Annotated, TypeAlias

from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.errors import schema as errors
from spec_schema.errors import units as unit_errors
from spec_schema.expressions.moments import Date, read_moment
from spec_schema.expressions.scanner import NUMBER_PATTERN, parse_length
from spec_schema.expressions.tree import Duration, Length, Samples
from spec_schema.fields.entry import RefusedError
from spec_schema.fields.leaf import Located
from spec_schema.fields.plain import reads, scalar
from spec_schema.units.parser import collisions, parse_unit
from spec_schema.units.quantity import Quantity, Range
from spec_schema.units.unit import Unit, UnitError, unit_symbol
from spec_schema.yaml_tree.nodes import Listing, Node, Scalar, kind

_QUANTITY = re.compile(
    rf"\s*(?P<number>[+-]?{NUMBER_PATTERN})(?:\s*(?P<unit>[^\s\d+\-.].*?|1/.*?))?\s*"
)
_NAMED_NUMBER = re.compile(r"[+-]?(?:\w*\.)?(?:(?P<inf>inf(?:inity)?)|pi)", re.IGNORECASE)
"""Spellings of infinity in YAML and Python libraries."""
_UNIT_START = re.compile(r"[A-Za-zͰ-ϿΩ%°µ]|1/")


def read_unit(node: Node, findings: Findings) -> Located[Unit]:
    """The unit that a node writes, with its place; reports an error for others."""
    wanted = "a unit such as `m/s`"
    match node:
        # `[kg]`, as units stand in papers and headers
        case Listing(items=[Scalar(text=meant)]):
            repair = f"write `{meant}`"
            findings.report(errors.wrong_kind(wanted, kind(node), node.span, repair, meant))
            raise RefusedError
        case _:
            found = scalar(node, findings, wanted)
    try:
        unit = parse_unit(found.text)
        for start, symbol, size, meant in collisions(found.text):
            span = found.positions.span(start, start + len(symbol))
            findings.report(errors.seldom_unit(symbol, size, meant, span))
        return Located(unit, found.span, found.key)
    except UnitError as error:
        span = found.positions.span(error.start, error.end)
        report = unit_errors.malformed_unit(error.message, span, error.repair, error.replacement)
        findings.report(report)
        raise RefusedError from error


def split_quantity(node: Scalar) -> tuple[Scalar, Scalar] | None:
    """The number and the unit of a text such as `5 N/m`; None for other texts."""
    found = _QUANTITY.fullmatch(node.text)
    # `5 e` and `3 x` are no quantities: a unit begins like a unit
    if found is None or not found["unit"] or _UNIT_START.match(found["unit"]) is None:
        return None
    return node.part(*found.span("number")), node.part(*found.span("unit"))


SMALLEST_DEVIATION, LARGEST_DEVIATION = 1e-100, 1e100
"""Between them a standard deviation has a variance, its square, with room for units."""


def has_variance(deviation: Quantity, findings: Findings) -> bool:
    """True if the square of a standard deviation above 0 is a positive finite float; else reports
    an error.
    """
    if SMALLEST_DEVIATION <= deviation.value <= LARGEST_DEVIATION:
        return True
    wanted = f"from {SMALLEST_DEVIATION:g} to {LARGEST_DEVIATION:g}: its square is used"
    findings.report(errors.out_of_range(deviation.text, deviation.span, wanted))
    return False


def read_quantity(node: Node, findings: Findings) -> Quantity:
    """The finite number that a node writes, with its unit or without; reports an error for
    others.
    """
    found = scalar(node, findings, "a quantity such as `2 mm`")
    if isinstance(found.value, float) and not math.isfinite(found.value):
        findings.report(errors.out_of_range(found.text, found.span, "finite", _repair(found.text)))
        raise RefusedError
    parts = split_quantity(found)
    text = parts[0].text if parts else found.text.strip()
    match = _QUANTITY.fullmatch(text)
    # a number may be too large for a float: `1e999` is ∞
    if isinstance(found.value, bool) or match is None or not math.isfinite(float(match["number"])):
        findings.report(errors.malformed_quantity(found.text[:60], found.span, _repair(text)))
        raise RefusedError
    unit = read_unit(parts[1], findings).value if parts else None
    return Quantity(float(match["number"]), unit, found.span)


def _repair(text: str) -> str | None:
    named = _NAMED_NUMBER.fullmatch(text)
    if named is None:
        return None
    if named["inf"]:
        return "leave a bound out where there is none"
    return f"write `{'-' * text.startswith('-')}{math.pi}`: a quantity is digits and a unit"


def read_length(node: Node, findings: Findings) -> Length:
    """The number of samples or the duration that a node writes; reports an error for others."""
    found = scalar(node, findings, "a length such as `50 ms`")
    length = parse_length(found.text, found.positions)
    if length is None:
        findings.report(errors.malformed_length(found.text[:60], found.span))
        raise RefusedError
    return length


def read_positive_length(node: Node, findings: Findings) -> Length:
    """The length above 0 that a node writes; reports an error for others."""
    length = read_length(node, findings)
    match length:
        case Samples(count=amount) | Duration(quantity=Quantity(value=amount)) if amount > 0:
            return length
        case _:
            findings.report(errors.out_of_range("0", node.span, "above 0"))
            raise RefusedError


SHORTEST_SAMPLE, LONGEST_SAMPLE = 1e-100, 1e100
"""Seconds; between them rates, slopes and windows in samples are numbers."""


def _read_sample_time(node: Node, findings: Findings) -> Quantity:
    second, hertz = unit_symbol("s"), unit_symbol("Hz")
    assert second is not None
    assert hertz is not None
    found = scalar(node, findings, "a sample time such as `50 ms`")
    has_unit = split_quantity(found) is not None
    # a bare number is no sample time: nobody could say whether it is of seconds
    quantity = read_quantity(found, findings) if has_unit else Quantity(0, None, found.span)
    unit = quantity.unit
    size = 0.0 if unit is None else unit.in_si(quantity.value)
    if unit is not None and size > 0:
        # `100 Hz` is 10 ms
        seconds = 1 / size if unit.exponents == hertz.exponents else size
        if unit.exponents in (second.exponents, hertz.exponents):
            if SHORTEST_SAMPLE <= seconds <= LONGEST_SAMPLE:
                return Quantity(seconds, second, found.span)
            wanted = f"from {SHORTEST_SAMPLE:g} s to {LONGEST_SAMPLE:g} s"
            findings.report(errors.out_of_range(found.text, found.span, wanted))
            raise RefusedError
    findings.report(errors.malformed_sample_time(found.text[:60], found.span))
    raise RefusedError


def _read_range(node: Node, findings: Findings) -> Range:
    if not isinstance(node, Listing) or len(node.items) != 2:
        repair = "write for example `[0, 1]`"
        found = "a list of another length" if isinstance(node, Listing) else kind(node)
        findings.report(errors.wrong_kind("a list of two numbers", found, node.span, repair))
        raise RefusedError
    low, high = (read_quantity(item, findings) for item in node.items)
    # ends in unlike units are compared once the compiler knows the signal's
    if low.unit == high.unit and low.value >= high.value:
        findings.report(errors.reversed_range(low.text, high.text, node.span))
        raise RefusedError
    return Range(low, high, node.span)


_NUMBER = rf"[+-]?{NUMBER_PATTERN}"
_FACTOR = r"(1|[^\s\d*/^()+-][^\s*/^()]*(\^[+-]?[0-9]+)?)"
_UNIT = rf"{_FACTOR}(\s*[*/]\s*{_FACTOR})*"
_UNIT_SCHEMA = {
    "type": ["string", "integer"],
    "pattern": rf"^\s*{_UNIT}\s*$",
    "minimum": 1,
    "maximum": 1,
}
QUANTITY = {
    "type": ["string", "number"],
    "pattern": rf"^\s*{_NUMBER}(\s*{_UNIT})?\s*$",
}
LENGTH_PATTERN = rf"[0-9]{{1,9}}|{NUMBER_PATTERN}[ \t]*(us|ms|s|min|h)"
_LENGTH = {
    "type": ["string", "integer"],
    "pattern": rf"^({LENGTH_PATTERN})$",
}
POSITIVE_LENGTH = {**_LENGTH, "minimum": 1}
_SAMPLE_TIME = {
    "type": "string",
    "pattern": rf"^\s*{_NUMBER}\s*{_UNIT}\s*$",
    "examples": ["10 ms", "100 Hz"],
}
_RANGE = {"type": "array", "items": QUANTITY, "minItems": 2, "maxItems": 2}
UnitField: TypeAlias = Annotated[Located[Unit], reads(read_unit, _UNIT_SCHEMA)]
QuantityField: TypeAlias = Annotated[Quantity, reads(read_quantity, QUANTITY)]
LengthField: TypeAlias = Annotated[Length, reads(read_length, {**_LENGTH, "minimum": 0})]
PositiveLength: TypeAlias = Annotated[Length, reads(read_positive_length, POSITIVE_LENGTH)]
SampleTime: TypeAlias = Annotated[Quantity, reads(_read_sample_time, _SAMPLE_TIME)]
RangeField: TypeAlias = Annotated[Range, reads(_read_range, _RANGE)]


RowOrTime: TypeAlias = Length | Date


def read_row_or_time(node: Node, findings: Findings) -> RowOrTime:
    """The row, time or ISO 8601 date that a node writes; reports an error for others."""
    found = scalar(node, findings, "a row, a time such as `50 ms` or a date")
    # a number alone is a length before it is a year
    length = parse_length(found.text, found.positions)
    if length is not None:
        return length
    moment = read_moment(found.text.strip())
    if moment is None:
        findings.report(errors.malformed_length(found.text[:60], found.span, may_be_date=True))
        raise RefusedError
    return Date(moment, found.text.strip(), found.span)


_DATE = r"[0-9]{4}-[0-9]{2}-[0-9]{2}([Tt ].*)?"
_ROW_OR_TIME = {
    "type": ["string", "integer"],
    "pattern": rf"^({LENGTH_PATTERN}|{_DATE})$",
    "minimum": 0,
}
RowOrTimeField: TypeAlias = Annotated[RowOrTime, reads(read_row_or_time, _ROW_OR_TIME)]

"""Parses durations of a spec: `50 ms`, or an integer number of samples."""

import re

from spec_schema.expressions.tree import Duration, Length, Samples
from spec_schema.units.quantity import Quantity
from spec_schema.units.unit import unit_symbol
from spec_schema.yaml_tree.nodes import Positions

NUMBER_PATTERN = r"(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
# `3 min(a, b)` is a missing operator before a function, not three minutes.
DURATION = re.compile(
    rf"(?P<number>{NUMBER_PATTERN})[ \t]*(?P<unit>us|ms|s|min|h)(?!\w)(?![ \t]*[(])"
)
_LENGTH = re.compile(r"(?P<samples>[0-9]{1,9})")


def parse_length(text: str, positions: Positions) -> Length | None:
    """Samples or a duration; None for other texts."""
    span = positions.span(0, len(text))
    samples = _LENGTH.fullmatch(text)
    if samples is not None:
        return Samples(int(text), span)
    found = DURATION.fullmatch(text)
    return None if found is None else duration_of(found, positions, span_start=0)


def duration_of(found: re.Match[str], positions: Positions, span_start: int) -> Duration | None:
    """The duration of a match of DURATION; None when its number is too large for a float."""
    value = float(found["number"])
    unit = unit_symbol(found["unit"])
    assert unit is not None
    # larger ones are infinite, or become so in another unit
    if value > _LONGEST_NUMBER:
        return None
    span = positions.span(span_start, span_start + len(found.group()))
    return Duration(Quantity(value, unit, span), span)


_LONGEST_NUMBER = 1e300

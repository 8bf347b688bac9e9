"""Leaf type of the schema for a place in a record: a row, a time from its beginning, a date."""

from typing import Annotated, TypeAlias

from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.errors import schema as errors
from spec_schema.expressions.durations import parse_length
from spec_schema.expressions.moments import Date, read_moment
from spec_schema.expressions.tree import Length
from spec_schema.fields.entry import RefusedError
from spec_schema.fields.plain import reads, scalar
from spec_schema.fields.quantities import LENGTH_PATTERN
from spec_schema.yaml_tree.nodes import Node

RowOrTime: TypeAlias = Length | Date


def read_row_or_time(node: Node, findings: Findings) -> RowOrTime:
    """A number of samples, a duration, or a date of ISO 8601."""
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

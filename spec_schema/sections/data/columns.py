"""Says which columns feed a signal: `col`, an index, a list or `tau{1..6}`; unit, scale."""

import re
from dataclasses import field
from typing import Annotated, ClassVar, TypeAlias

from pydantic import ValidationInfo

from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import Span
from spec_schema.errors import schema as errors
from spec_schema.fields.entry import Entry, RefusedError, findings_of
from spec_schema.fields.leaf import Gathering, one_or_many
from spec_schema.fields.plain import number, read_items, reads, scalar
from spec_schema.fields.quantities import UnitField
from spec_schema.late_dataclass import dataclass
from spec_schema.yaml_tree.nodes import Node, Scalar

_PATTERN = re.compile(r"([^{}]*)\{([0-9]{1,4})\.\.([0-9]{1,4})\}([^{}]*)")


@dataclass(frozen=True)
class ColumnName:
    """A column of a file, by the name in its header or by its index from 0."""

    column: str | int
    span: Span = field(compare=False)


def _read_column(node: Node, findings: Findings) -> ColumnName:
    found = scalar(node, findings, "a column's name or index")
    value = found.value
    # quoted it is a name: a header may call a column "3"
    if isinstance(value, int) and not isinstance(value, bool):
        if value < 0:
            findings.report(errors.out_of_range(found.text, found.span, "at least 0"))
            raise RefusedError
        return ColumnName(value, found.span)
    return ColumnName(found.text, found.span)


def _expanded(node: Node, info: ValidationInfo) -> tuple[Node, ...]:
    """The nodes of the columns; `tau{1..3}` becomes tau1, tau2, tau3."""
    columns: list[Node] = []
    for item in read_items(node, info):
        if isinstance(item, Scalar) and ("{" in item.text or "}" in item.text):
            columns.extend(_pattern(item, findings_of(info)))
        else:
            columns.append(item)
    return tuple(columns)


def _pattern(node: Scalar, findings: Findings) -> list[Node]:
    found = _PATTERN.fullmatch(node.text)
    # `{1..3}` counts upwards; two patterns in one name would leave open which runs first
    if found is None or int(found[2]) > int(found[3]):
        findings.report(errors.malformed_columns(node.text, node.span))
        raise RefusedError
    before, first, last, after = found.groups()
    names = [f"{before}{index}{after}" for index in range(int(first), int(last) + 1)]
    # as text: a pattern makes names, never the index that `3` alone would be
    return [
        Scalar(
            text=name,
            value=name,
            quoted=True,
            positions=node.positions,
            span=node.span,
            key=node.key,
        )
        for name in names
    ]


_COLUMN = {"type": ["string", "integer"], "minimum": 0}
ColumnField: TypeAlias = Annotated[ColumnName, reads(_read_column, _COLUMN)]


class Column(Entry):
    """The columns of one signal: value = scale * cell + offset, in `unit`."""

    noun: ClassVar[str] = "a column"
    shorthand: ClassVar[str | None] = "column"

    column: Annotated[tuple[ColumnField, ...], Gathering(_expanded, schema=one_or_many)]
    """Name or index of the column, a list of them, or a pattern `tau{1..6}`."""
    unit: UnitField | None = None
    """Unit of the column, converted to that of the signal."""
    scale: Annotated[float, number()] = 1.0
    """Factor of the cells."""
    offset: Annotated[float, number()] = 0.0
    """Added after the factor."""

"""Named dimensions: `joint: 6`, or `joint: [shoulder, elbow]`."""

from dataclasses import field
from typing import Annotated, TypeAlias

from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.errors import schema as errors
from spec_schema.fields.entry import RefusedError
from spec_schema.fields.located import KeyAndValueSpan
from spec_schema.fields.plain import read_count, reads, scalar
from spec_schema.late_dataclass import dataclass
from spec_schema.yaml_tree.nodes import Listing, Node, Scalar


@dataclass(frozen=True)
class Dimension:
    """A dimension's size, and the labels of its positions; () where only the size is given."""

    size: int
    labels: tuple[str, ...]
    place: KeyAndValueSpan = field(compare=False)


def _read_dimension(node: Node, findings: Findings) -> Dimension:
    place = KeyAndValueSpan(node.key or node.span, node.span)
    if not isinstance(node, Listing):
        return Dimension(read_count(node, findings, least=1), (), place)
    labels: dict[str, Scalar] = {}
    for item in node.items:
        label = scalar(item, findings, "a label")
        # by their text: `1` and `01` are two labels
        first = labels.setdefault(label.text, label)
        if first is not label:
            findings.report(errors.repeated_item(label.text, label.span, first.span))
    if not labels:
        findings.report(errors.empty_section("a list of labels", node.span))
        raise RefusedError
    return Dimension(len(labels), tuple(labels), place)


_LABEL = {"type": ["string", "number", "boolean"]}
_SCHEMA = {
    "type": ["integer", "array"],
    "minimum": 1,
    "items": _LABEL,
    "minItems": 1,
    "uniqueItems": True,
}
DimensionField: TypeAlias = Annotated[Dimension, reads(_read_dimension, _SCHEMA)]

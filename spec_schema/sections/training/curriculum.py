"""Lets the rollouts of a stage grow: each entry has a length and the epoch up to which it holds."""

from dataclasses import field
from typing import Annotated, TypeAlias

from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import Span
from spec_schema.errors import schema as errors
from spec_schema.expressions.tree import Length
from spec_schema.fields.entry import RefusedError
from spec_schema.fields.plain import reads
from spec_schema.fields.quantities import POSITIVE_LENGTH, read_positive_length
from spec_schema.late_dataclass import dataclass
from spec_schema.yaml_tree.nodes import Node, Table, kind


@dataclass(frozen=True)
class Lesson:
    """To the end of epoch `until` rollouts have `horizon`."""

    until: int
    horizon: Length
    span: Span = field(compare=False)


@dataclass(frozen=True)
class Curriculum:
    """`{epoch: horizon, …}`: lessons in the order in which they are written."""

    lessons: tuple[Lesson, ...]
    span: Span = field(compare=False)


def _read_curriculum(node: Node, findings: Findings) -> Curriculum:
    if not isinstance(node, Table) or not node.entries:
        found = "an empty mapping" if isinstance(node, Table) else kind(node)
        repair = "write for example `{20: 5, 40: 20}`: 5 samples up to epoch 20, then 20"
        findings.report(
            errors.wrong_kind("a mapping of epochs to horizons", found, node.span, repair)
        )
        raise RefusedError
    return Curriculum(
        tuple(
            Lesson(
                _epoch(name, node.keys[name], findings),
                read_positive_length(value, findings),
                node.keys[name],
            )
            for name, value in node.entries.items()
        ),
        node.span,
    )


def _epoch(text: str, span: Span, findings: Findings) -> int:
    # keys of a mapping are text; digits of other scripts are decimal to Python too
    if text.isascii() and text.isdecimal() and 0 < len(text) <= _DIGITS and int(text) > 0:
        return int(text)
    findings.report(errors.out_of_range(text[:40], span, "the number of an epoch, from 1"))
    raise RefusedError


# as many as every 32-bit number has; int() of longer texts may take its time
_DIGITS = 9

_SCHEMA = {
    "type": "object",
    "minProperties": 1,
    "propertyNames": {"pattern": "^[0-9]*[1-9][0-9]*$"},
    "additionalProperties": POSITIVE_LENGTH,
}
CurriculumField: TypeAlias = Annotated[Curriculum, reads(_read_curriculum, _SCHEMA)]

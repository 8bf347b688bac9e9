"""Lays out the input struct of a controller: the fields of disturbances and references."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from backends.c_language.rendering import comment_text
from backends.ports.identifiers import c_identifier
from compiler.ir.types import Type
from compiler.jacobian.matrices import Member, Vector
from msnn.features.control.problem.optimal_control import ControlProblem


@dataclass(frozen=True, slots=True, kw_only=True)
class SeriesField:
    """A field of the input struct: `samples` samples of `count` elements each, oldest first.

    It holds one disturbance or reference.
    """

    name: str
    identifier: str
    comment: str
    first: int
    """Index of its first element among the disturbances and references of a stage."""
    count: int
    """Elements per sample."""
    window: int
    """Samples that one stage reads."""
    samples: int
    """Samples in the field; the last one is held beyond."""

    @property
    def size(self) -> int:
        """The number of elements of the field."""
        return self.samples * self.count

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of the field in C; () for a scalar."""
        return () if self.size == 1 else (self.size,)


def input_fields(problem: ControlProblem) -> tuple[SeriesField, ...]:
    """Lists the fields of the input struct other than x: disturbances, then references."""
    taken = {"x"}
    first = 0
    fields: list[SeriesField] = []
    for member, ahead in _members(problem):
        window = Type(member.axes).window or 1
        # previewed ports have the samples of all stages, and those that windows read beyond
        samples = ahead + window - 1 if member.name in problem.previewed else 1
        count = member.size // window
        fields.append(
            SeriesField(
                name=member.name,
                identifier=c_identifier(member.name, taken),
                comment=_comment(member, count, samples),
                first=first,
                count=count,
                window=window,
                samples=samples,
            )
        )
        first += member.size
    return tuple(fields)


def quantity_lines(vector: Vector, letter: str) -> list[str]:
    """Returns one comment line per quantity of a vector: its C elements, name and unit."""
    return [
        comment_text(
            f"{letter}[{m.first}]"
            + (f" ... {letter}[{m.first + m.size - 1}]" if m.size > 1 else "")
            + f": {m.name}"
            + (f" [{m.unit.text}]" if m.unit is not None else "")
        )
        for m in vector.members
    ]


def _members(problem: ControlProblem) -> Iterator[tuple[Member, int]]:
    """Yields each disturbance with N stages (t … t+N−1), each reference with N + 1 (t … t+N)."""
    yield from ((member, problem.horizon) for member in problem.disturbances.members)
    yield from ((member, problem.horizon + 1) for member in problem.references.members)


def _comment(member: Member, count: int, samples: int) -> str:
    """Returns the comment of a field: name, unit, samples and elements."""
    unit = f" [{member.unit.text}]" if member.unit is not None else ""
    known = f", samples t ... t+{samples - 1}" if samples > 1 else ", held"
    each = f", {count} numbers each" if count > 1 else ""
    return comment_text(f"{member.name}{unit}{known}{each}")

"""Says what a controller is given beside the state: fields of its input, and their layout."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from backends.c_language.comments import comment_text
from backends.ports.identifiers import c_identifier
from compiler.ir.types import Type
from compiler.jacobian.matrices import Member, Vector
from msnn.features.control.problem.optimal_control.problem import ControlProblem


@dataclass(frozen=True, slots=True, kw_only=True)
class SeriesField:
    """A disturbance or a reference: `samples` of `count` numbers, one sample after the other."""

    name: str
    identifier: str
    comment: str
    first: int
    """Place of its first number among those of a stage."""
    count: int
    window: int
    """Samples that a stage reads."""
    samples: int
    """Samples that are given; the last one is held."""

    @property
    def size(self) -> int:
        """Numbers of the field."""
        return self.samples * self.count

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of the field in C; () for a number."""
        return () if self.size == 1 else (self.size,)


def input_fields(problem: ControlProblem) -> tuple[SeriesField, ...]:
    """The fields beside x, in the order of the problem."""
    taken = {"x"}
    first = 0
    found: list[SeriesField] = []
    for member, ahead in _members(problem):
        window = Type(member.axes).window or 1
        # previewed ports hold the samples of all stages, and what windows read beyond
        samples = ahead + window - 1 if member.name in problem.previewed else 1
        count = member.size // window
        found.append(
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
    return tuple(found)


def quantity_lines(vector: Vector, letter: str) -> list[str]:
    """One line a quantity: where it stands, its unit."""
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
    """Disturbances are known at t … t+N−1, references at t … t+N."""
    yield from ((member, problem.horizon) for member in problem.disturbances.members)
    yield from ((member, problem.horizon + 1) for member in problem.references.members)


def _comment(member: Member, count: int, samples: int) -> str:
    unit = f" [{member.unit.text}]" if member.unit is not None else ""
    known = f", samples t ... t+{samples - 1}" if samples > 1 else ", held"
    each = f", {count} numbers each" if count > 1 else ""
    return comment_text(f"{member.name}{unit}{known}{each}")

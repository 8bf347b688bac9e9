"""How records are divided into the sets train, val and test."""

from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Literal, TypeAlias

from pydantic import ValidationInfo, model_validator

from spec_schema.diagnostics import Findings
from spec_schema.entry import Entry, RefusedError, findings_of
from spec_schema.errors import schema as errors
from spec_schema.plain_fields import PositiveCount, choice, read_count, read_number, reads
from spec_schema.source import Span
from spec_schema.yaml_nodes import Listing, Node


@dataclass(frozen=True)
class Fraction:
    """A share of the files or rows, 0 to 1."""

    value: float
    span: Span = field(compare=False)


@dataclass(frozen=True)
class Blocks:
    """Blocks by their numbers, from 1."""

    numbers: tuple[int, ...]
    span: Span = field(compare=False)


def _read_share(node: Node, findings: Findings) -> Fraction | Blocks:
    if isinstance(node, Listing):
        numbers = tuple(read_count(item, findings, least=1) for item in node.items)
        return Blocks(numbers, node.span)
    value = read_number(node, findings)
    if not 0 <= value <= 1:
        findings.report(errors.out_of_range(f"{value:g}", node.span, "from 0 to 1"))
        raise RefusedError
    return Fraction(value, node.span)


Share: TypeAlias = Annotated[Fraction | Blocks, reads(_read_share)]


class Split(Entry):
    """`by: file` and `by: fraction` take fractions, `by: block` takes numbers of blocks.

    `by: fraction` cuts each record in time: train first, then val, then test. Without `train`
    what the others leave is its share.
    """

    noun: ClassVar[str] = "split"
    later: ClassVar[frozenset[str]] = frozenset({"k"})

    by: Annotated[
        Literal["file", "block", "fraction"],
        choice("file", "block", "fraction", later=("time", "kfold")),
    ] = "file"
    train: Share | None = None
    val: Share | None = None
    test: Share | None = None
    blocks: PositiveCount | None = None

    @property
    def shares(self) -> tuple[Fraction | Blocks, ...]:
        """The shares that are given."""
        return tuple(share for share in (self.train, self.val, self.test) if share is not None)

    @model_validator(mode="after")
    def _fits(self, info: ValidationInfo) -> "Split":
        findings = findings_of(info)
        key = self.place.key
        if not self.shares:
            findings.report(errors.misfitting_split("split names no set", key))
        if (self.by == "block") != (self.blocks is not None):
            problem = "`blocks:` goes with `by: block`, and only with it"
            findings.report(errors.misfitting_split(problem, key))
        taken: set[int] = set()
        total = 0.0
        for share in self.shares:
            match share:
                case Fraction(value=value):
                    total += value
                    fits = self.by != "block" and total <= 1 + _ROUNDING
                    problem = "with `by: block` a set is a list of block numbers"
                    problem = problem if self.by == "block" else "the fractions exceed 1"
                case Blocks(numbers=numbers):
                    most = self.blocks or 0
                    inside = all(number <= most for number in numbers)
                    fits = self.by == "block" and inside and taken.isdisjoint(numbers)
                    taken.update(numbers)
                    problem = f"block numbers go from 1 to {most}, each in one set"
                    if self.by != "block":
                        problem = "numbers of blocks need `by: block`"
            if not fits:
                findings.report(errors.misfitting_split(problem, share.span))
        return self


# 0.7 + 0.2 + 0.1 exceeds 1 by one unit in the last place.
_ROUNDING = 1e-9

"""Divides records into the sets train, val and test."""

from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import Annotated, ClassVar, Literal, TypeAlias

from pydantic import ValidationInfo, model_validator

from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import Span
from spec_schema.errors import schema as errors
from spec_schema.expressions.moments import Date
from spec_schema.expressions.tree import Duration
from spec_schema.fields.entry import Entry, RefusedError, findings_of
from spec_schema.fields.moments import read_row_or_time
from spec_schema.fields.plain import PositiveCount, choice, read_count, read_number, reads
from spec_schema.late_dataclass import dataclass
from spec_schema.yaml_tree.nodes import Listing, Node, Scalar

SETS = ("train", "val", "test")
"""What a split makes of a source."""


# spans are no part of a share's value: two specs that say the same are equal
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


@dataclass(frozen=True)
class TimeRange:
    """`[60 s, 80 s]`: rows whose time is from `start` on and before `stop`, in seconds."""

    start: float
    stop: float
    span: Span = field(compare=False)


@dataclass(frozen=True)
class DateRange:
    """`[2026-03-01, 2026-03-08]`: rows whose date is from `start` on and before `stop`."""

    start: Date
    stop: Date
    span: Span = field(compare=False)


OneShare: TypeAlias = Fraction | Blocks | TimeRange | DateRange


def _read_share(node: Node, findings: Findings) -> OneShare:
    if isinstance(node, Listing):
        # `60 s` is text to YAML and a number of a block is none
        if any(isinstance(item, Scalar) and isinstance(item.value, str) for item in node.items):
            return _read_time_range(node, findings)
        numbers = tuple(read_count(item, findings, least=1) for item in node.items)
        if not numbers:
            report = errors.misfitting_split("a list without blocks", node.span, "write `[1]`")
            findings.report(report)
            raise RefusedError
        return Blocks(numbers, node.span)
    value = read_number(node, findings)
    if not 0 <= value <= 1:
        findings.report(errors.out_of_range(f"{value:g}", node.span, "from 0 to 1"))
        raise RefusedError
    return Fraction(value, node.span)


def _read_time_range(node: Listing, findings: Findings) -> TimeRange | DateRange:
    match [read_row_or_time(item, findings) for item in node.items]:
        case [Duration() as start, Duration() as stop] if start.seconds < stop.seconds:
            return TimeRange(start.seconds, stop.seconds, node.span)
        case [Date() as start, Date() as stop] if _comes_before(start, stop):
            return DateRange(start, stop, node.span)
        case _:
            problem = "a range of time is its start and its end, which comes later"
            repair = "write `[60 s, 80 s]` or `[2026-11-22 17:00, 2026-11-22 18:00]`"
            findings.report(errors.misfitting_split(problem, node.span, repair))
            raise RefusedError


def _comes_before(start: Date, stop: Date) -> bool:
    one, other = start.moment, stop.moment
    # a date with a zone and one without do not compare
    return one.has_zone == other.has_zone and one.nanoseconds < other.nanoseconds


def _are_apart(one: TimeRange | DateRange, other: TimeRange | DateRange) -> bool:
    """Whether no moment is in both; a time and a date may be the same, and so may two clocks."""
    match one, other:
        case TimeRange(), TimeRange():
            return one.stop <= other.start or other.stop <= one.start
        case DateRange(), DateRange():
            if one.start.moment.has_zone != other.start.moment.has_zone:
                return False
            return not (
                _comes_before(other.start, one.stop) and _comes_before(one.start, other.stop)
            )
        case _:
            return False


_SHARE = {
    "type": ["number", "array"],
    "minimum": 0,
    "maximum": 1,
    "items": {"type": ["integer", "string"], "minimum": 1},
    "minItems": 1,
    "uniqueItems": True,
}
Share: TypeAlias = Annotated[OneShare, reads(_read_share, _SHARE)]


class Split(Entry):
    """`by: file` and `by: fraction` take fractions, `by: block` takes numbers of blocks, `by: time`
    ranges of time such as `[60 s, 80 s]`, or of dates, whose end is not in it.

    `by: fraction` cuts each record in time: train first, then val, then test. Without `train`
    what the others leave is its share. `by: kfold` makes `k` folds, of files where there are at
    least so many and else of blocks of each record: fold number `fold` is val, the others train.
    """

    noun: ClassVar[str] = "split"
    example: ClassVar[str | None] = "{train: 0.8, val: 0.2}"

    by: Annotated[
        Literal["file", "block", "fraction", "time", "kfold"],
        choice("file", "block", "fraction", "time", "kfold"),
    ] = "file"
    """What is divided: files, blocks of rows, each record in time, or folds."""
    train: Share | None = None
    """Fraction, or numbers of blocks; by default what the others leave."""
    val: Share | None = None
    """Fraction, or numbers of blocks: they decide which weights are best."""
    test: Share | None = None
    """Fraction, or numbers of blocks: they are only measured on."""
    blocks: PositiveCount | None = None
    """How many blocks a record is cut into."""
    k: PositiveCount | None = None
    """How many folds are made."""
    fold: PositiveCount = 1
    """Number of the fold that is val, from 1."""

    @property
    def shares(self) -> tuple[OneShare, ...]:
        """The shares that are given."""
        return tuple(share for share in (self.train, self.val, self.test) if share is not None)

    @model_validator(mode="after")
    def _fits(self, info: ValidationInfo) -> "Split":
        findings = findings_of(info)
        key = self.place.key
        if self.by == "kfold":
            self._folds(findings)
            return self
        if self.k is not None or self.fold != 1:
            problem, repair = "`k:` and `fold:` go with `by: kfold`", "write `by: kfold` too"
            findings.report(errors.misfitting_split(problem, key, repair))
        if not self.shares:
            repair = f"add `val: {_EXAMPLES[self.by]}`"
            findings.report(errors.misfitting_split("split names no set", key, repair))
        if (self.by == "block") != (self.blocks is not None):
            problem = "`blocks:` goes with `by: block`, and only with it"
            repair = "add `blocks: 10`" if self.by == "block" else "write `by: block` too"
            findings.report(errors.misfitting_split(problem, key, repair))
        # in the order train, val, test, so that the later of two that overlap is underlined
        before: list[OneShare] = []
        for share in self.shares:
            if (misfit := self._misfit(share, before)) is not None:
                findings.report(errors.misfitting_split(misfit[0], share.span, misfit[1]))
            before.append(share)
        return self

    def _misfit(self, share: OneShare, before: Sequence[OneShare]) -> tuple[str, str] | None:
        """The reason why a share does not fit those before it, and its repair."""
        wanted = f"write for example `{_EXAMPLES[self.by]}`"
        # a share of another kind than `by:` wants fits nothing, whatever its numbers are
        match share:
            case Fraction(value=value) if self.by in ("file", "fraction"):
                # below 1 is legal: rows that no set takes are left out
                rest = 1 - sum(other.value for other in before if isinstance(other, Fraction))
                if value > rest + _ROUNDING:
                    return "the fractions exceed 1", f"write `{max(rest, 0):.6g}` or less"
            case Blocks(numbers=numbers) if self.by == "block":
                return self._misfit_of_blocks(numbers, before)
            case TimeRange() | DateRange() if self.by == "time":
                ranges = (other for other in before if isinstance(other, TimeRange | DateRange))
                if not all(_are_apart(share, other) for other in ranges):
                    return (
                        "no moment belongs to two sets: all ranges are of one kind and apart",
                        "begin it where the other one ends",
                    )
            # the guards above have let through the kinds that fit: here the kind itself is wrong
            case Fraction():
                return _WANTED[self.by], wanted
            case Blocks():
                return _WANTED.get(self.by, "numbers of blocks need `by: block`"), wanted
            case TimeRange() | DateRange():
                return _WANTED.get(self.by, "ranges of time need `by: time`"), wanted
        return None

    def _misfit_of_blocks(
        self, numbers: Sequence[int], before: Sequence[OneShare]
    ) -> tuple[str, str] | None:
        most = self.blocks or 0
        taken = {n for other in before if isinstance(other, Blocks) for n in other.numbers}
        for place, number in enumerate(numbers):
            if number > most:
                return f"there are {most} blocks, and no block {number}", "write a number of those"
            if number in taken:
                return f"block {number} is in another set already", f"leave {number} out of one"
            if number in numbers[:place]:
                return f"block {number} is listed twice", f"write {number} once"
        return None

    def _folds(self, findings: Findings) -> None:
        key = self.place.key
        if self.shares or self.blocks is not None:
            problem = "with `by: kfold` the folds are the sets"
            repair = "write `k:` and `fold:` only"
            findings.report(errors.misfitting_split(problem, key, repair))
        if self.k is None or self.k < 2:
            problem, repair = "`by: kfold` needs `k:`, at least 2", "write `k: 5`"
            findings.report(errors.misfitting_split(problem, key, repair))
        elif self.fold > self.k:
            problem = f"there is no fold {self.fold}: folds go from 1 to {self.k}"
            findings.report(errors.misfitting_split(problem, key, f"write `fold: {self.k}`"))


_WANTED: Mapping[str, str] = {
    "block": "with `by: block` a set is a list of block numbers",
    "time": "with `by: time` a set is a range of time",
}
_EXAMPLES: Mapping[str, str] = {
    "file": "0.2",
    "fraction": "0.2",
    "block": "[1]",
    "time": "[60 s, 80 s]",
}
# 0.7 + 0.2 + 0.1 exceeds 1 by one unit in the last place.
_ROUNDING = 1e-9

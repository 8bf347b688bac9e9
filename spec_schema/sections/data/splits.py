"""Divides records into the sets train, val and test."""

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
    """Rows whose time is from `start` on and before `stop`, in seconds."""

    start: float
    stop: float
    span: Span = field(compare=False)


@dataclass(frozen=True)
class DateRange:
    """Rows whose date is from `start` on and before `stop`."""

    start: Date
    stop: Date
    span: Span = field(compare=False)


OneShare: TypeAlias = Fraction | Blocks | TimeRange | DateRange


def _read_share(node: Node, findings: Findings) -> OneShare:
    if isinstance(node, Listing):
        if any(isinstance(item, Scalar) and isinstance(item.value, str) for item in node.items):
            return _read_time_range(node, findings)
        numbers = tuple(read_count(item, findings, least=1) for item in node.items)
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
            problem = (
                "a range of time is its start and its end, such as `[60 s, 80 s]` or "
                "`[2026-11-22 17:00, 2026-11-22 18:00]`"
            )
            findings.report(errors.misfitting_split(problem, node.span))
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
            findings.report(errors.misfitting_split("`k:` and `fold:` go with `by: kfold`", key))
        if not self.shares:
            findings.report(errors.misfitting_split("split names no set", key))
        if (self.by == "block") != (self.blocks is not None):
            problem = "`blocks:` goes with `by: block`, and only with it"
            findings.report(errors.misfitting_split(problem, key))
        taken: set[int] = set()
        total = 0.0
        times: list[TimeRange | DateRange] = []
        for share in self.shares:
            # a share of another kind than `by:` wants fits nothing, whatever its numbers are
            match share:
                case Fraction(value=value):
                    total += value
                    fits = self.by in ("file", "fraction") and total <= 1 + _ROUNDING
                    problem = _WANTED.get(self.by, "the fractions exceed 1")
                case Blocks(numbers=numbers):
                    most = self.blocks or 0
                    inside = all(number <= most for number in numbers)
                    fits = self.by == "block" and inside and taken.isdisjoint(numbers)
                    taken.update(numbers)
                    problem = f"block numbers go from 1 to {most}, each in one set"
                    if self.by != "block":
                        problem = _WANTED.get(self.by, "numbers of blocks need `by: block`")
                case TimeRange() | DateRange():
                    fits = self.by == "time" and all(_are_apart(share, t) for t in times)
                    problem = "no moment belongs to two sets: all ranges are of one kind and apart"
                    if self.by != "time":
                        problem = _WANTED.get(self.by, "ranges of time need `by: time`")
                    times.append(share)
            if not fits:
                findings.report(errors.misfitting_split(problem, share.span))
        return self

    def _folds(self, findings: Findings) -> None:
        key = self.place.key
        if self.shares or self.blocks is not None:
            problem = "with `by: kfold` the folds are the sets: write `k:` and `fold:` only"
            findings.report(errors.misfitting_split(problem, key))
        if self.k is None or self.k < 2:
            findings.report(errors.misfitting_split("`by: kfold` needs `k:`, at least 2", key))
        elif self.fold > self.k:
            problem = f"there is no fold {self.fold}: folds go from 1 to {self.k}"
            findings.report(errors.misfitting_split(problem, key))


_WANTED = {
    "block": "with `by: block` a set is a list of block numbers",
    "time": "with `by: time` a set is a range of time such as `[60 s, 80 s]`",
}
# 0.7 + 0.2 + 0.1 exceeds 1 by one unit in the last place.
_ROUNDING = 1e-9

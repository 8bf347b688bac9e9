"""The `data` section: files, rows, columns of the records, and their sets train, val, test."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import Annotated, ClassVar, Literal, TypeAlias

from pydantic import Field, ValidationInfo, model_validator

from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import Span
from spec_schema.errors import schema as errors
from spec_schema.expressions.moments import Date
from spec_schema.expressions.scanner import NUMBER_PATTERN, parse_length
from spec_schema.expressions.time_format import FormatFault, time_format, written_format
from spec_schema.expressions.time_zones import is_zone, near_zones
from spec_schema.expressions.tree import Duration
from spec_schema.fields.entry import BySignal, Entry, Named, RefusedError, findings_of
from spec_schema.fields.formulas import ConditionField
from spec_schema.fields.leaf import Choice, Gathering, Located, one_or_many
from spec_schema.fields.plain import (
    Character,
    LocatedText,
    ManyOf,
    NonNegativeCount,
    PositiveCount,
    Switch,
    choice,
    number,
    read_count,
    read_items,
    read_number,
    reads,
    scalar,
)
from spec_schema.fields.quantities import RowOrTimeField, UnitField, read_row_or_time
from spec_schema.late_dataclass import dataclass
from spec_schema.units.parser import parse_unit
from spec_schema.yaml_tree.nodes import Listing, Node, Scalar

_COLUMN_RANGE = re.compile(r"([^{}]*)\{([0-9]{1,4})\.\.([0-9]{1,4})\}([^{}]*)")


@dataclass(frozen=True)
class ColumnName:
    """A column of a file, by the name in its header or by its index from 0; `span` is its place in
    the spec.
    """

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
    """The nodes of the columns in a list or single value; a pattern `tau{1..3}` becomes tau1, tau2,
    tau3. Malformed patterns are reported, then RefusedError is raised.
    """
    columns: list[Node] = []
    for item in read_items(node, info):
        if isinstance(item, Scalar) and ("{" in item.text or "}" in item.text):
            columns.extend(_columns_of_range(item, findings_of(info)))
        else:
            columns.append(item)
    return tuple(columns)


def _columns_of_range(node: Scalar, findings: Findings) -> list[Node]:
    found = _COLUMN_RANGE.fullmatch(node.text)
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


def _read_mark(node: Node, findings: Findings) -> Located[float | str]:
    found = scalar(node, findings, "a number or a text")
    value = found.value
    if not found.text.strip() or value is None:
        findings.report(errors.empty_value("a mark of missing values", found.span))
        raise RefusedError
    if isinstance(value, bool) or not isinstance(value, int | float):
        return Located(found.text.strip(), found.span, found.key)
    if not math.isfinite(value):
        # NaN is missing in every file, and infinity is a mistake in every file
        findings.report(errors.out_of_range(found.text, found.span, "finite, or a text"))
        raise RefusedError
    return Located(float(value), found.span, found.key)


def _marks(node: Node, info: ValidationInfo) -> tuple[Node, ...]:
    items = read_items(node, info)
    if not items:
        wanted, repair = "a mark of missing values", "write `[-9999]`, or leave the key out"
        findings_of(info).report(errors.wrong_kind(wanted, "an empty list", node.span, repair))
        raise RefusedError
    return items


Mark: TypeAlias = Annotated[Located[float | str], reads(_read_mark, {"type": ["number", "string"]})]
Marks: TypeAlias = Annotated[
    tuple[Mark, ...], Gathering(_marks, schema=lambda mark: {**one_or_many(mark), "minItems": 1})
]


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
    missing: Marks | None = None
    """Numbers and texts of cells that mean: not measured."""


SETS = ("train", "val", "test")
"""What a split makes of a source."""


# spans are no part of a share's value: two specs that say the same are equal
@dataclass(frozen=True)
class Fraction:
    """A share of the files or rows, from 0 to 1."""

    value: float
    span: Span = field(compare=False)


@dataclass(frozen=True)
class Blocks:
    """Blocks of rows by their numbers, counted from 1."""

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
    """True if two ranges have no moment in common; False if one is a time and the other a date."""
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
    """How the data are divided into the sets train, val and test.

    `by: file` and `by: fraction` take fractions, `by: block` takes numbers of blocks. `by: time`
    takes ranges of time such as `[60 s, 80 s]`, or of dates, whose end is not included. `by:
    fraction` cuts each record in time: train first, then val, then test. Without `train`, that set
    gets what the others leave. `by: kfold` makes `k` folds, of files if there are at least `k`,
    else of blocks of each record: fold number `fold` is val, the others train.
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
        """The given shares of train, val and test."""
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
        """The reason why a share does not fit the key `by:` or the shares before it, and its
        repair; None if it fits.
        """
        wanted = f"write for example `{_EXAMPLES[self.by]}`"
        # a share of another kind than `by:` wants fits nothing, whatever its numbers are
        match share:
            case Fraction(value=value) if self.by in ("file", "fraction"):
                # below 1 is legal: rows that no set takes are left out
                rest = 1 - sum(other.value for other in before if isinstance(other, Fraction))
                if value > rest + _SHARE_ROUNDING:
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
                return _FORM_OF_SETS[self.by], wanted
            case Blocks():
                return _FORM_OF_SETS.get(self.by, "numbers of blocks need `by: block`"), wanted
            case TimeRange() | DateRange():
                return _FORM_OF_SETS.get(self.by, "ranges of time need `by: time`"), wanted
        return None

    def _misfit_of_blocks(
        self, numbers: Sequence[int], before: Sequence[OneShare]
    ) -> tuple[str, str] | None:
        most = self.blocks or 0
        taken = {n for other in before if isinstance(other, Blocks) for n in other.numbers}
        for place, block in enumerate(numbers):
            if block > most:
                return f"there are {most} blocks, and no block {block}", "write a number of those"
            if block in taken:
                return f"block {block} is in another set already", f"leave {block} out of one"
            if block in numbers[:place]:
                return f"block {block} is listed twice", f"write {block} once"
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


_FORM_OF_SETS: Mapping[str, str] = {
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
_SHARE_ROUNDING = 1e-9


LEAST_GAP = 1.0


def _read_gap(node: Node, findings: Findings) -> float | Duration:
    """A number of steps, or a duration; a number is never taken for samples."""
    found = scalar(node, findings, "a number of steps such as `2.5`, or a duration")
    if isinstance(found.value, str):
        length = parse_length(found.text, found.positions)
        if not isinstance(length, Duration):
            repair = "write `2.5`, times the sample time, or a duration such as `300 ms`"
            findings.report(errors.wrong_kind("a number or a duration", "text", found.span, repair))
            raise RefusedError
        if not length.seconds > 0:
            findings.report(errors.out_of_range(found.text, found.span, "above 0 s"))
            raise RefusedError
        return length
    value = read_number(node, findings)
    if not value > LEAST_GAP:
        wanted = "a number above 1 or a duration: a step of one sample time is no hole"
        findings.report(errors.out_of_range(f"{value:g}", found.span, wanted))
        raise RefusedError
    return value


_GAP = {
    "type": ["number", "string"],
    "exclusiveMinimum": LEAST_GAP,
    "pattern": rf"^{NUMBER_PATTERN}[ \t]*(us|ms|s|min|h)$",
}
GapField: TypeAlias = Annotated[float | Duration, reads(_read_gap, _GAP)]


THOUSANDS: Mapping[str, str] = {
    ".": ".",
    ",": ",",
    "'": "'\u2019",
    "\u2019": "'\u2019",
    **dict.fromkeys(" \u00a0\u2009\u202f", " \u00a0\u2009\u202f"),
}
"""Signs of thousands; each with the signs that it means: apostrophes, and blanks of any width."""


def _read_thousands(node: Node, findings: Findings) -> Choice[str]:
    found = scalar(node, findings, "a sign of thousands")
    if found.text not in THOUSANDS:
        wanted, repair = "a sign of thousands", 'write `"."`, `","`, `"\'"` or `" "`'
        findings.report(errors.wrong_kind(wanted, f"`{found.text}`", found.span, repair))
        raise RefusedError
    return Choice(found.text, found.span, found.key)


ThousandsField: TypeAlias = Annotated[
    Choice[str], reads(_read_thousands, {"type": "string", "enum": list(THOUSANDS)})
]


class Csv(Entry):
    """The layout of a text file: `skip` lines, then a header if there is one, then rows.

    Without `delimiter`, commas separate the cells, in `.tsv` files tabs.
    """

    noun: ClassVar[str] = "csv"

    delimiter: Character | None = None
    """Character between cells; a comma, or a tab in .tsv files."""
    decimal: Character = "."
    """Decimal point or comma."""
    thousands: ThousandsField | None = None
    """Sign between groups of three digits: point, comma, apostrophe or blank."""
    comment: Character | None = None
    """Lines that start with it are passed over."""
    header: Switch = True
    """Whether the first line names the columns."""
    skip: NonNegativeCount = 0
    """Lines before the header."""

    @model_validator(mode="after")
    def _has_one_meaning_of_thousands(self, info: ValidationInfo) -> "Csv":
        if (found := self.thousands) is not None:
            if self.decimal in THOUSANDS[found.value]:
                other = {".": ",", ",": "."}.get(found.value, ".")
                is_default = "decimal" not in self.model_fields_set
                role = "the default decimal sign" if is_default else "the decimal sign"
                repair = f'write the decimal sign of the file, such as `decimal: "{other}"`'
                report = errors.ambiguous_thousands(found.value, role, found.span, repair)
                findings_of(info).report(report)
            elif self.delimiter is not None and self.delimiter in THOUSANDS[found.value]:
                role = "separates cells"
                repair = "name the true one of the two, or remove `thousands:`"
                report = errors.ambiguous_thousands(found.value, role, found.span, repair)
                findings_of(info).report(report)
        return self


def _read_format(node: Node, findings: Findings) -> Located[str]:
    found = scalar(node, findings, "a format of dates such as `%d/%m/%Y %H:%M:%S`")
    fault = time_format(found.text)
    if isinstance(fault, FormatFault):
        span = found.positions.span(fault.first, fault.last)
        findings.report(errors.bad_time_format(found.text, fault.reason, fault.repair, span))
        raise RefusedError
    return Located(found.text, found.span, found.key)


def _read_zone(node: Node, findings: Findings) -> Located[str]:
    found = scalar(node, findings, "a time zone such as `Europe/Berlin`")
    if not is_zone(found.text):
        findings.report(errors.unknown_zone(found.text, near_zones(found.text), found.span))
        raise RefusedError
    return Located(found.text, found.span, found.key)


FormatField: TypeAlias = Annotated[Located[str], reads(_read_format, {"type": "string"})]
ZoneField: TypeAlias = Annotated[Located[str], reads(_read_zone, {"type": "string"})]


class TimeColumn(Entry):
    """The column that holds the time of each row, in seconds unless `unit` says otherwise.

    With `format` its cells are dates, and with `zone` dates of a clock in that time zone.
    """

    noun: ClassVar[str] = "time"
    shorthand: ClassVar[str | None] = "column"

    column: ColumnField
    """Name or index of the column."""
    unit: UnitField | None = None
    """Unit of time; s by default."""
    format: FormatField | None = None
    """How dates are written, in directives of strptime; by default ISO 8601."""
    zone: ZoneField | None = None
    """Time zone of the logger's clock; by default dates state it, or it is unknown."""

    @model_validator(mode="after")
    def _is_time(self, info: ValidationInfo) -> "TimeColumn":
        if self.format is not None:
            self._check_format(self.format, findings_of(info))
        if self.unit is not None and not self.unit.value.same_dimension(SECOND):
            findings_of(info).report(errors.no_unit_of_time(self.unit.value.text, self.unit.span))
        return self

    def _check_format(self, text: Located[str], findings: Findings) -> None:
        if self.unit is not None:
            reason, repair = "`unit:` is of numbers", "remove `unit:` or `format:`"
            findings.report(errors.bad_time_format(text.value, reason, repair, self.unit.span))
        if self.zone is not None and written_format(text.value).has_zone:
            reason = "`%z` reads the offset of each date, and `zone:` states one for all"
            repair = "remove `zone:`, or write the offset as the characters that it has"
            findings.report(errors.bad_time_format(text.value, reason, repair, self.zone.span))


SECOND = parse_unit("s")


class Layout(Entry):
    """The layout of the files of one set, or the default for all sets.

    `from` and `to` are the first and the last row that are used, both included: numbers of rows
    from 0, times of the time column, or dates if this column has dates. `join` makes one record of
    files that follow each other in time. `filter` keeps the rows for which a comparison of signals
    holds. A key that is not given has the default of all sets.
    """

    # `from` is a word of Python
    first: RowOrTimeField | None = Field(default=None, alias="from")
    """First row (from 0), time or date that is used."""
    last: RowOrTimeField | None = Field(default=None, alias="to")
    """Last row, time or date that is used."""
    every: PositiveCount | None = None
    """Use one row in so many."""
    columns: BySignal[Column] = Field(default_factory=dict[str, Column])
    """Signal on the left, column on the right; by default they have one name."""
    time: TimeColumn | None = None
    """Column of the times."""
    csv: Csv | None = None
    """How the text files are laid out."""
    resample: (
        Annotated[
            Literal["error", "none", "linear", "nearest"],
            choice("error", "none", "linear", "nearest"),
        ]
        | None
    ) = None
    """What becomes of rows that are not one sample time apart."""
    gap: GapField | None = None
    """Longest step that `resample` fills: times the sample time (2.5), or a duration."""
    join: Switch | None = None
    """Whether files that follow each other in time are one record."""
    filter: ConditionField | None = None
    """Rows that are kept: those for which a comparison of signals holds."""
    records: Annotated[Literal["file", "row_group"], choice("file", "row_group")] | None = None
    """What a record is: a file, or a row group of a Parquet file, which is read at a time."""
    missing: Marks | None = None
    """Numbers and texts of cells that mean: not measured."""
    duplicates: (
        Annotated[
            Literal["first", "last", "mean", "error"], choice("first", "last", "mean", "error")
        ]
        | None
    ) = None
    """The row that is used of successive rows with one time, or their mean; else an error."""


class Source(Layout):
    """The files of one set: names or globs, relative to the spec."""

    noun: ClassVar[str] = "a data source"
    shorthand: ClassVar[str | None] = "files"

    files: ManyOf[LocatedText]
    """Globs or names, relative to the spec."""


class Data(Layout):
    """The files of each set of data, with defaults for all sets."""

    noun: ClassVar[str] = "data"

    source: Named[Source]
    """Files of each set: globs, relative to the spec."""
    split: Split | None = None
    """How records are divided into train, val and test."""
    nan: Annotated[Literal["error", "drop", "split"], choice("error", "drop", "split")] = "error"
    """What becomes of records with missing inputs."""
    keep: Annotated[Literal["memory", "disk"], choice("memory", "disk")] = "memory"
    """Where signals lie while a command runs: data larger than memory lie on disk."""

    @property
    def sets(self) -> tuple[str, ...]:
        """The names of all sets: those of `source`, and those that a split makes."""
        # a dict drops what is named twice: a source may be called `test` while a split makes one
        # too
        split = SETS if self.split is not None else ()
        return tuple(dict.fromkeys((*self.source, *split)))

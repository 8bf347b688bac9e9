"""The `data` section: files, rows and columns of the measured records."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field, ValidationInfo, model_validator

from spec_schema.errors import schema as errors
from spec_schema.fields.entry import Entry, findings_of
from spec_schema.fields.formulas import ConditionField
from spec_schema.fields.moments import RowOrTimeField
from spec_schema.fields.named_tables import BySignal, Named
from spec_schema.fields.plain import (
    Character,
    LocatedText,
    ManyOf,
    NonNegativeCount,
    PositiveCount,
    Switch,
    choice,
)
from spec_schema.fields.quantities import UnitField
from spec_schema.sections.data.columns import Column, ColumnField
from spec_schema.sections.data.splits import SETS, Split
from spec_schema.units.parser import parse_unit


class Csv(Entry):
    """The layout of a text file: `skip` lines, then a header if there is one, then rows.

    Without `delimiter` cells are separated by commas, in `.tsv` files by tabs.
    """

    noun: ClassVar[str] = "csv"

    delimiter: Character | None = None
    """Character between cells; a comma, or a tab in .tsv files."""
    decimal: Character = "."
    """Decimal point or comma."""
    comment: Character | None = None
    """Lines that start with it are passed over."""
    header: Switch = True
    """Whether the first line names the columns."""
    skip: NonNegativeCount = 0
    """Lines before the header."""


class TimeColumn(Entry):
    """The column that holds the time of each row, in seconds unless `unit` says otherwise."""

    noun: ClassVar[str] = "time"
    shorthand: ClassVar[str | None] = "column"

    column: ColumnField
    """Name or index of the column."""
    unit: UnitField | None = None
    """Unit of time; s by default."""

    @model_validator(mode="after")
    def _is_time(self, info: ValidationInfo) -> "TimeColumn":
        if self.unit is not None and not self.unit.value.same_dimension(SECOND):
            findings_of(info).report(errors.no_unit_of_time(self.unit.value.text, self.unit.span))
        return self


SECOND = parse_unit("s")


class Layout(Entry):
    """The layout of one set of files, or the default of all; None where it is not given.

    `first` and `last` (written `from`, `to`) are rows from 0, times of the time column, or dates
    where these are dates, both inclusive. `join` makes one record of files that follow each other
    in time; `filter` keeps the rows for which a comparison of signals holds.
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
    join: Switch | None = None
    """Whether files that follow each other in time are one record."""
    filter: ConditionField | None = None
    """Rows that are kept: those for which a comparison of signals holds."""
    records: Annotated[Literal["file", "row_group"], choice("file", "row_group")] | None = None
    """What a record is: a file, or a row group of a Parquet file, which is read at a time."""


class Source(Layout):
    """The files of one set; globs, relative to the spec."""

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
        """The sets that it makes: its sources, and those of a split."""
        # a dict drops what is named twice: a source may be called `test` while a split makes one
        # too
        split = SETS if self.split is not None else ()
        return tuple(dict.fromkeys((*self.source, *split)))

"""The `data` section: files, rows and columns of the measured records."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from spec_schema.columns import Column, ColumnField
from spec_schema.entry import Entry
from spec_schema.named_tables import Named
from spec_schema.plain_fields import (
    Character,
    LocatedText,
    ManyOf,
    NonNegativeCount,
    PositiveCount,
    Switch,
    choice,
)
from spec_schema.quantity_fields import LengthField
from spec_schema.splits import Split


class Csv(Entry):
    """How a text file is laid out: `skip` lines, then a header if there is one, then rows."""

    noun: ClassVar[str] = "csv"

    delimiter: Character = ","
    decimal: Character = "."
    comment: Character | None = None
    header: Switch = True
    skip: NonNegativeCount = 0


class Layout(Entry):
    """What may be said of one set of files, or of all as a default; None where unsaid.

    `first` and `last` (written `from`, `to`) are rows from 0, or times of the time column, both
    inclusive.
    """

    later: ClassVar[frozenset[str]] = frozenset({"filter"})

    first: LengthField | None = Field(default=None, alias="from")
    last: LengthField | None = Field(default=None, alias="to")
    every: PositiveCount | None = None
    columns: Named[Column] = Field(default_factory=dict[str, Column])
    time: ColumnField | None = None
    csv: Csv | None = None
    resample: (
        Annotated[Literal["error", "none"], choice("error", "none", later=("linear", "nearest"))]
        | None
    ) = None


class Source(Layout):
    """The files of one set; globs, relative to the spec."""

    noun: ClassVar[str] = "a data source"
    shorthand: ClassVar[str | None] = "files"

    files: ManyOf[LocatedText]


class Data(Layout):
    """Where the data of each set is, with defaults for all sets."""

    noun: ClassVar[str] = "data"

    source: Named[Source]
    split: Split | None = None
    nan: Annotated[Literal["error", "drop", "split"], choice("error", "drop", "split")] = "error"

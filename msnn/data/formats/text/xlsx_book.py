"""Opens Excel workbooks, and distinguishes date formats from number formats with units."""

from __future__ import annotations

import re
import warnings
from collections.abc import Generator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

_LITERAL = re.compile(r'"[^"]*"|[\\_*].|\[(?!(?:h+|m+|s+)\])[^\]]*\]', re.IGNORECASE | re.DOTALL)
"""Literals in a number format: quoted text, fills, colours, conditions; `[h]` is a duration."""
_PARTS_OF_SECONDS = re.compile(r"(s\]?)[.,]?0+", re.IGNORECASE)
_NUMBER = re.compile(r"[0#?]|General|Standard", re.IGNORECASE)
_DATE = re.compile(r"[dmhys]", re.IGNORECASE)


def is_date_format(code: str) -> bool:
    """True if a number format shows its cells as dates, times or durations.

    Digits other than fractions of a second make it a number format: in `0.0 km/h`, m and h are a
    unit.
    """
    plain = _LITERAL.sub("", code).partition(";")[0]
    plain = _PARTS_OF_SECONDS.sub(r"\1", plain)
    return _NUMBER.search(plain) is None and _DATE.search(plain) is not None


@contextmanager
def first_sheet(path: Path, *, data_only: bool = True) -> Generator[Any]:
    """The first sheet of a workbook, with cells as dates if `is_date_format` is true.

    `data_only` yields the saved values of formulas, otherwise their texts.
    """
    # an optional package without types
    openpyxl: Any = import_module("openpyxl")
    formats: Any = import_module("openpyxl.styles.numbers")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # styles that it does not know
        book: Any = openpyxl.load_workbook(path, read_only=True, data_only=data_only)
        try:
            own: list[str] = list(book._number_formats)
            first_own: int = formats.BUILTIN_FORMATS_MAX_SIZE
            codes = (
                formats.BUILTIN_FORMATS.get(style.numFmtId, "")
                if style.numFmtId < first_own
                else own[style.numFmtId - first_own]
                for style in book._cell_styles
            )
            # by its own rule any `m` or `h` that is not quoted makes a date
            book._date_formats = {index for index, code in enumerate(codes) if is_date_format(code)}
            sheet: Any = book.worksheets[0]
            sheet.reset_dimensions()  # a size that the file states may be smaller than the sheet
            yield sheet
        finally:
            book.close()

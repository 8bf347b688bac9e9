"""Finds the units that the number formats of a workbook's cells show: `0%`, `0.0 "km/h"`."""

from __future__ import annotations

import re
import warnings
import zipfile
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from msnn.data.formats.written_units import UnknownUnit, stated_unit
from spec_schema.units.unit import ONE, Unit

_STYLES = "xl/styles.xml"
_MOST = 1 << 20
_SHOWS_UNIT = re.compile(rb'%|&quot;|numFmtId="(?:9|10)"')
"""In the styles of a workbook; 9 and 10 are the built-in formats of percents."""
_ROWS = 100
_QUOTED = re.compile(r'"([^"]*)"|\\(.)')


def units_of_formats(path: Path) -> Mapping[int, Unit | UnknownUnit]:
    """The unit that the first number of each column is shown with, by the column's index.

    A cell in percent holds the ratio itself: 0.5 where 50 % is shown.
    """
    if not _may_show_units(path):
        return {}
    openpyxl: Any = import_module("openpyxl")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # styles that it does not know
        book: Any = openpyxl.load_workbook(path, read_only=True, data_only=True)
        sheet: Any = book.worksheets[0]
        sheet.reset_dimensions()
        formats: dict[int, str] = {}
        for row in sheet.iter_rows(max_row=_ROWS):
            for index, cell in enumerate(row):
                if cell.data_type == "n" and cell.value is not None:
                    formats.setdefault(index, str(cell.number_format))
        book.close()
    found = {index: _unit(format) for index, format in formats.items()}
    return {index: unit for index, unit in found.items() if unit is not None}


def _may_show_units(path: Path) -> bool:
    # most workbooks show none, and opening one takes time
    try:
        with zipfile.ZipFile(path) as book, book.open(_STYLES) as styles:
            return _SHOWS_UNIT.search(styles.read(_MOST)) is not None
    except (OSError, KeyError, zipfile.BadZipFile):
        return False


def _unit(format: str) -> Unit | UnknownUnit | None:
    # of several sections the first is that of positive numbers
    section = format.split(";")[0]
    if "%" in _QUOTED.sub("", section):
        return ONE
    return stated_unit("".join(plain or letter for plain, letter in _QUOTED.findall(section)))

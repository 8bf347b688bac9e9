"""Finds the units that the number formats of a workbook's cells show: `0%`, `0.0 "km/h"`."""

from __future__ import annotations

import re
import warnings
import zipfile
from collections.abc import Collection, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from msnn.data.formats.capital_units import CapitalUnit
from msnn.data.formats.written_units import ShownUnit, UnknownUnit, stated_unit
from spec_schema.units.unit import ONE, Unit

_STYLES = "xl/styles.xml"
_MOST = 1 << 20
_SHOWS_UNIT = re.compile(rb'%|&quot;|numFmtId="(?:9|10)"')
"""In the styles of a workbook; 9 and 10 are the built-in formats of percents."""
_QUOTED = re.compile(r'"([^"]*)"|\\(.)')


def units_of_formats(
    path: Path, columns: Collection[int], after: int
) -> Mapping[int, tuple[ShownUnit, ...]]:
    """The units with which the numbers of columns are shown below row `after`, by index.

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
        formats: dict[int, dict[str, list[str]]] = {index: {} for index in columns}
        for row in sheet.iter_rows(min_row=after + 1):
            for index in columns:
                cell = row[index] if index < len(row) else None
                if cell is not None and cell.data_type == "n" and cell.value is not None:
                    cells = formats[index].setdefault(str(cell.number_format), [])
                    cells.append(str(cell.coordinate))
        book.close()
    return {index: _shown(found) for index, found in formats.items()}


def _shown(formats: Mapping[str, list[str]]) -> tuple[ShownUnit, ...]:
    """The different units of formats, each with the cells that show it."""
    found: dict[str, tuple[Unit | CapitalUnit | UnknownUnit | None, list[str]]] = {}
    for text, cells in formats.items():
        unit = _unit(text)
        # formats of one unit differ in their digits
        found.setdefault("" if unit is None else unit.text, (unit, []))[1].extend(cells)
    return tuple(ShownUnit(unit, cells[0], len(cells)) for unit, cells in found.values())


def _may_show_units(path: Path) -> bool:
    # most workbooks show none, and opening one takes time
    try:
        with zipfile.ZipFile(path) as book, book.open(_STYLES) as styles:
            return _SHOWS_UNIT.search(styles.read(_MOST)) is not None
    except (OSError, KeyError, zipfile.BadZipFile):
        return False


def _unit(format: str) -> Unit | CapitalUnit | UnknownUnit | None:
    # of several sections the first is that of positive numbers
    section = format.split(";")[0]
    if "%" in _QUOTED.sub("", section):
        return ONE
    return stated_unit("".join(plain or letter for plain, letter in _QUOTED.findall(section)))

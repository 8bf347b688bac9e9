"""Writes random data sets in many file formats, units and clocks, with the keys that read them.

Values are those of the tables to the last digits: a unit, a header or a clock changes how they are
written, but not what msnn should read.
"""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import TypeAlias

import h5py
import numpy as np
import openpyxl
import pandas as pd
from numpy.typing import NDArray
from scipy.io import savemat

Values: TypeAlias = NDArray[np.float64]
Table: TypeAlias = dict[str, Values]
"""Columns t in s, u in V, z in K, y in m/s."""

UNITS: Mapping[str, Sequence[tuple[str, float, float]]] = {
    "u": [("V", 1, 0), ("mV", 1e3, 0), ("kV", 1e-3, 0)],
    "z": [("K", 1, 0), ("degC", 1, -273.15), ("°C", 1, -273.15), ("mK", 1e3, 0)],
    "y": [("m/s", 1, 0), ("km/h", 3.6, 0), ("mm/s", 1e3, 0), ("m/min", 60, 0)],
    "t": [("s", 1, 0), ("ms", 1e3, 0), ("us", 1e6, 0), ("min", 1 / 60, 0)],
}
"""Units of files; a number of a table times the factor plus the offset is a number of a file."""
_TEXT = {"csv": ",", "tsv": "\t", "txt": "|", "dat": ";"}
_MISSING = ("", "", "NaN", "nan", "n/a", "NULL", "-")
_FORMATS: Mapping[str, Sequence[str]] = {
    "": ("%d.%m.%Y %H:%M:%S.%f", "%Y%m%d%H%M%S%f", "%a %b %d %I:%M:%S.%f %p %Y"),
    "Z": ("%d/%m/%y %H:%M:%S.%f%z", "%Y-%jT%H:%M:%S.%f %z"),
    "+01:00": ("%m/%d/%Y %H:%M:%S.%f %z", "%d %B %Y %H:%M:%S.%f"),
}
"""Formats of dates by zone; those without `%z` are of the clock of a zone of Europe, in winter."""
_BEGIN = datetime(2026, 11, 22, 17)


@dataclass(frozen=True)
class Clock:
    """How times are written: in a unit, or as dates with or without a time zone."""

    unit: tuple[str, float, float]
    zone: str | None = None
    has_dated_keys: bool = False
    """Whether `from`, `to` and `split` are dates too: seconds from the time 0 of tables."""

    @property
    def is_date(self) -> bool:
        return self.zone is not None


def drawn_clock(rng: random.Random) -> Clock:
    zone = rng.choice(["", "Z", "+01:00"]) if rng.random() < 0.25 else None
    unit = rng.choice(UNITS["t"]) if rng.random() < 0.5 else UNITS["t"][0]
    return Clock(unit, zone, zone is not None and rng.random() < 0.5)


def key_text(text: str, clock: Clock) -> str:
    """The text of a key's value; seconds become dates if the clock writes dates."""
    if not clock.has_dated_keys:
        return text

    def dated(found: re.Match[str]) -> str:
        return f'"{_date(float(found[1]), clock)}"'

    return re.sub(r"([\d.]+) s\b", dated, text)


def _date(seconds: float, clock: Clock) -> str:
    moment = _BEGIN + timedelta(microseconds=round(1e6 * seconds))
    return f"{moment.isoformat(' ', 'microseconds')}{clock.zone}"


@dataclass(frozen=True)
class _Column:
    """A column of a file: its name in the spec, its header, its unit and where the unit is
    written.
    """

    name: str
    unit: str
    where: str
    """header, parentheses, line, format, attribute, unit or scale, as keys of the spec; empty where
    the unit is the declared one."""
    number: int | None = None
    """Of files without header."""

    @property
    def header(self) -> str:
        form = {"header": "{} [{}]", "parentheses": "{} ({})"}.get(self.where, "{}")
        return form.format(self.name, self.unit)

    @property
    def key(self) -> str:
        """The entry of the column in the spec."""
        place = self.name if self.number is None else str(self.number)
        _, factor, offset = _unit(self)
        how = {
            "unit": f", unit: {self.unit.replace('°C', 'degC')}",
            "scale": f", scale: {1 / factor!r}, offset: {-offset / factor!r}",
        }.get(self.where, "")
        return f"{{column: {place}{how}}}" if how else place


def _unit(column: _Column) -> tuple[str, float, float]:
    return next((unit for unit in UNITS[column.name] if unit[0] == column.unit), ("", 1, 0))


def write_files(
    tables: Sequence[Table], clock: Clock, folder: Path, rng: random.Random
) -> tuple[list[str], dict[str, str]]:
    """Writes the tables as files; returns their names, and the keys of `data:` that read them."""
    kinds = [*_TEXT, "xlsx", "parquet", "h5", "mat", "npz"]
    # arrays hold no dates
    kind = rng.choice(kinds[:6] if clock.is_date else kinds)
    columns = _columns(kind, clock, rng)
    comma = kind in ("txt", "dat") and rng.random() < 0.6
    thousands = None
    if kind in ("txt", "dat"):
        thousands = rng.choice([None, "." if comma else ",", "'", " ", "\u202f"])
    preamble = rng.choice([0, 0, 2]) if kind in _TEXT else 0
    comment = rng.choice([None, None, "#"]) if kind in _TEXT else None
    layout = {
        "delimiter": {"txt": '"|"', "dat": '";"'}.get(kind),
        "decimal": '","' if comma else None,
        "thousands": thousands and f'"{thousands}"',
        "skip": preamble or None,
        "comment": comment and f'"{comment}"',
        "header": None if columns[0].number is None else "false",
    }
    said = [f"{key}: {value}" for key, value in layout.items() if value is not None]
    keys = {"time": next(column.key for column in columns if column.name == "t")}
    written = rng.choice(_FORMATS[clock.zone or ""]) if clock.is_date and rng.random() < 0.5 else ""
    written = written if kind in (*_TEXT, "xlsx") else ""
    if written:
        zone = ", zone: Europe/Berlin" if clock.zone == "+01:00" and "%z" not in written else ""
        keys["time"] = f'{{column: {keys["time"]}, format: "{written}"{zone}}}'
    others = [f"{c.name}: {c.key}" for c in columns if c.name != "t" and c.key != c.name]
    keys |= {"columns": f"{{{', '.join(others)}}}"} if others else {}
    keys |= {"csv": f"{{{', '.join(said)}}}"} if said else {}
    mark = rng.choice([None, None, "-9999", "fault"][: 4 if kind in (*_TEXT, "xlsx") else 3])
    keys |= {"missing": f"[{mark}, 1e30]"} if mark else {}
    names: list[str] = []
    for index, table in enumerate(tables):
        name = f"{'abc'[index]}.{kind}"
        names.append(name)
        cells = {one.name: _cells(table[one.name], one, clock, written) for one in columns}
        if mark is not None:
            cells |= {name: _marked(cells[name], mark, rng) for name in "uzy"}
        path = folder / name
        if kind in _TEXT:
            text = _text(
                columns, cells, rng, _TEXT[kind], comma=comma, thousands=thousands, comment=comment
            )
            lines = [*(f"logged by {name}, no. {k}" for k in range(preamble)), *text]
            # with and without a byte order mark
            path.write_text("\n".join(lines) + "\n", rng.choice(["utf-8", "utf-8-sig"]))
        else:
            _WRITERS[kind](path, columns, cells)
    return names, keys


def _columns(kind: str, clock: Clock, rng: random.Random) -> list[_Column]:
    places = {
        "xlsx": ["header", "parentheses", "line", "format", "unit", "scale"],
        "parquet": ["header", "parentheses", "unit", "scale"],
        "h5": ["attribute", "unit", "scale"],
        "mat": ["unit", "scale"],
        "npz": ["unit", "scale"],
    }.get(kind, ["header", "parentheses", "line", "unit", "scale"])
    found: list[_Column] = []
    has_header = kind not in _TEXT or rng.random() < 0.8
    if not has_header:
        places = ["unit", "scale"]
    # a line of units states all of them
    has_line = "line" in places and rng.random() < 0.3
    for number, name in enumerate(rng.sample("tuzy", 4)):
        unit = clock.unit if name == "t" else rng.choice(UNITS[name])
        place = "line" if has_line else rng.choice([one for one in places if one != "line"])
        if name == "t" and clock.is_date:
            unit, place = ("", 1, 0), ""
        elif name == "t" and place == "scale":
            place = "unit"
        elif unit == UNITS[name][0] and place in ("unit", "scale") and rng.random() < 0.5:
            place = ""
        found.append(_Column(name, unit[0], place, None if has_header else number))
    return found


def _cells(values: Values, column: _Column, clock: Clock, written: str) -> list[float | str]:
    """The values as numbers in the unit of the file, or as dates, in ISO 8601 or a format."""
    if column.name == "t" and written:
        moments = [_BEGIN + timedelta(microseconds=round(1e6 * value)) for value in values]
        return [moment.strftime(written.replace("%z", clock.zone or "")) for moment in moments]
    if column.name == "t" and clock.is_date:
        return [_date(value, clock) for value in values]
    _, factor, offset = _unit(column)
    return [float(value) for value in values * factor + offset]


def _marked(cells: Sequence[float | str], mark: str, rng: random.Random) -> list[float | str]:
    """The cells with the mark in some that lack a value."""
    sign = mark if mark == "fault" else float(mark)
    return [sign if cell != cell and rng.random() < 0.5 else cell for cell in cells]


def _text(
    columns: Sequence[_Column],
    cells: Mapping[str, Sequence[float | str]],
    rng: random.Random,
    delimiter: str,
    *,
    comma: bool,
    thousands: str | None,
    comment: str | None,
) -> list[str]:
    """The lines of a text file."""
    lines: list[str] = []
    if columns[0].number is None:
        lines.append(delimiter.join(column.header for column in columns))
    if any(column.where == "line" for column in columns):
        lines.append(delimiter.join(column.unit for column in columns))

    def text(cell: float | str) -> str:
        if isinstance(cell, str):
            return cell
        if np.isnan(cell):
            return rng.choice(_MISSING)
        whole, point, rest = repr(cell).partition(".")
        if thousands is not None and rng.random() < 0.8:
            whole = f"{int(whole):,}".replace(",", thousands) if whole.lstrip("-") != "0" else whole
        return whole + (point and "," if comma else point) + rest

    for row in zip(*(cells[column.name] for column in columns), strict=True):
        if comment is not None and rng.random() < 0.2:
            lines.append(f"{comment} paused")
        lines.append(delimiter.join(map(text, row)))
    return lines


def _write_xlsx(
    path: Path, columns: Sequence[_Column], cells: Mapping[str, Sequence[float | str]]
) -> None:
    book = openpyxl.Workbook()
    sheet = book.active
    assert sheet is not None
    sheet.append([column.header for column in columns])
    if any(column.where == "line" for column in columns):
        sheet.append([column.unit for column in columns])
    for row in zip(*(cells[column.name] for column in columns), strict=True):
        sheet.append([None if cell != cell else cell for cell in row])
        for index, column in enumerate(columns, start=1):
            if column.where == "format":
                # with and without quotes
                quote = '"' if sheet.max_row % 2 else ""
                sheet.cell(sheet.max_row, index).number_format = f"0.0 {quote}{column.unit}{quote}"
    book.save(path)


def _write_parquet(
    path: Path, columns: Sequence[_Column], cells: Mapping[str, Sequence[float | str]]
) -> None:
    series = {
        one.header: pd.to_datetime(values) if isinstance(values[0], str) else values
        for one in columns
        for values in [list(cells[one.name])]
    }
    pd.DataFrame(series).to_parquet(path)


def _write_hdf5(
    path: Path, columns: Sequence[_Column], cells: Mapping[str, Sequence[float | str]]
) -> None:
    with h5py.File(path, "w") as file:
        for column in columns:
            file[column.name] = np.asarray(cells[column.name], dtype=float)
            if column.where == "attribute":
                file[column.name].attrs["units"] = column.unit


def _arrays(
    columns: Sequence[_Column], cells: Mapping[str, Sequence[float | str]]
) -> dict[str, Values]:
    return {one.name: np.asarray(cells[one.name], dtype=float) for one in columns}


_Writer: TypeAlias = Callable[[Path, Sequence[_Column], Mapping[str, Sequence[float | str]]], None]
_WRITERS: Mapping[str, _Writer] = {
    "xlsx": _write_xlsx,
    "parquet": _write_parquet,
    "h5": _write_hdf5,
    "mat": lambda path, columns, cells: savemat(path, _arrays(columns, cells)),
    "npz": lambda path, columns, cells: np.savez(path, **_arrays(columns, cells)),
}

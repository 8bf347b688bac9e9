"""Writes drawn data sets as files of many formats, units and clocks, with the keys that read them.

Values are those of the tables to the last digits: a unit, a header or a clock changes how they are
written and nothing that should be read.
"""

from __future__ import annotations

import random
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
_BEGIN = datetime(2026, 11, 22, 17)


@dataclass(frozen=True)
class Clock:
    """How times are written: in a unit, or as dates with or without a zone."""

    unit: tuple[str, float, float]
    zone: str | None = None

    @property
    def is_date(self) -> bool:
        return self.zone is not None


def drawn_clock(rng: random.Random) -> Clock:
    zone = rng.choice(["", "Z", "+01:00"]) if rng.random() < 0.25 else None
    return Clock(rng.choice(UNITS["t"]) if rng.random() < 0.5 else UNITS["t"][0], zone)


@dataclass(frozen=True)
class _Column:
    """A column of files: its name in the spec, its header, its unit and where that stands."""

    name: str
    unit: str
    where: str
    """header, line, format, attribute, spec, or empty where the unit is the declared one."""

    @property
    def header(self) -> str:
        return f"{self.name} [{self.unit}]" if self.where == "header" else self.name


def write_files(
    tables: Sequence[Table], clock: Clock, folder: Path, rng: random.Random
) -> tuple[list[str], dict[str, str]]:
    """The names of the files that it writes, and the keys of `data:` that read them."""
    kinds = [*_TEXT, "xlsx", "parquet", "h5", "mat", "npz"]
    # arrays hold no dates
    kind = rng.choice(kinds[:6] if clock.is_date else kinds)
    columns = _columns(kind, clock, rng)
    comma = kind in ("txt", "dat") and rng.random() < 0.6
    keys = _keys(kind, columns, comma)
    preamble = rng.choice([0, 0, 2]) if kind in _TEXT else 0
    if preamble:
        keys["csv"] = (
            keys.get("csv", "{}").replace("{", f"{{skip: {preamble}, ").replace(", }", "}")
        )
    names: list[str] = []
    for index, table in enumerate(tables):
        name = f"{'abc'[index]}.{kind}"
        names.append(name)
        cells = {one.name: _cells(table[one.name], one, clock) for one in columns}
        path = folder / name
        if kind in _TEXT:
            _write_text(path, columns, cells, rng, comma=comma, preamble=preamble)
        else:
            _WRITERS[kind](path, columns, cells)
    return names, keys


def _columns(kind: str, clock: Clock, rng: random.Random) -> list[_Column]:
    places = {
        "xlsx": ["header", "line", "format", "spec"],
        "parquet": ["header", "spec"],
        "h5": ["attribute", "spec"],
        "mat": ["spec"],
        "npz": ["spec"],
    }.get(kind, ["header", "line", "spec"])
    found: list[_Column] = []
    # a line of units states all of them
    has_line = "line" in places and rng.random() < 0.3
    for name in rng.sample("tuzy", 4):
        unit = clock.unit if name == "t" else rng.choice(UNITS[name])
        place = "line" if has_line else rng.choice([one for one in places if one != "line"])
        if name == "t" and clock.is_date:
            unit, place = ("", 1, 0), ""
        elif unit == UNITS[name][0] and place == "spec" and rng.random() < 0.5:
            place = ""
        found.append(_Column(name, unit[0], place))
    return found


def _keys(kind: str, columns: Sequence[_Column], comma: bool) -> dict[str, str]:
    in_spec = {one.name: one.unit.replace("°C", "degC") for one in columns if one.where == "spec"}
    keys = {"time": f"{{column: t, unit: {in_spec['t']}}}" if "t" in in_spec else "t"}
    others = [f"{n}: {{column: {n}, unit: {u}}}" for n, u in in_spec.items() if n != "t"]
    if others:
        keys["columns"] = f"{{{', '.join(others)}}}"
    said = {"txt": ['delimiter: "|"'], "dat": ['delimiter: ";"']}.get(kind, [])
    if comma:
        said.append('decimal: ","')
    if said:
        keys["csv"] = f"{{{', '.join(said)}}}"
    return keys


def _cells(values: Values, column: _Column, clock: Clock) -> list[float | str]:
    """Numbers in the unit of the file, or dates."""
    if column.name == "t" and clock.is_date:
        moments = (_BEGIN + timedelta(microseconds=round(1e6 * v)) for v in values)
        return [f"{moment.isoformat(' ', 'microseconds')}{clock.zone}" for moment in moments]
    _, factor, offset = next(unit for unit in UNITS[column.name] if unit[0] == column.unit)
    return [float(value) for value in values * factor + offset]


def _write_text(
    path: Path,
    columns: Sequence[_Column],
    cells: Mapping[str, Sequence[float | str]],
    rng: random.Random,
    *,
    comma: bool,
    preamble: int,
) -> None:
    delimiter = _TEXT[path.suffix[1:]]
    lines = [*(f"logged by {path.name} no. {k}" for k in range(preamble))]
    lines.append(delimiter.join(column.header for column in columns))
    if any(column.where == "line" for column in columns):
        lines.append(delimiter.join(column.unit for column in columns))

    def text(cell: float | str) -> str:
        if isinstance(cell, str):
            return cell
        if np.isnan(cell):
            return rng.choice(_MISSING)
        return repr(cell).replace(".", ",") if comma else repr(cell)

    for row in zip(*(cells[column.name] for column in columns), strict=True):
        lines.append(delimiter.join(map(text, row)))
    path.write_text("\n".join(lines) + "\n", encoding=rng.choice(["utf-8", "utf-8-sig"]))


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
    frame = pd.DataFrame({column.header: cells[column.name] for column in columns})
    for name in frame.select_dtypes("object").columns:
        frame[name] = pd.to_datetime(frame[name])
    frame.to_parquet(path)


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

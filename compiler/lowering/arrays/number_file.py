"""Reads a text file of numbers, written by anybody: one row a line, within fixed limits."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from compiler.ir.scalars.table import Array
from spec_schema.reading.endless_files import is_near, refuse_endless

LARGEST_FILE = 20_000_000
"""Bytes; as many numbers as an array of a program can have are a few times fewer."""

_QUOTED = 40
"""Characters of a cell that a message quotes."""
# blanks beside a comma belong to it: `1, 2` has no empty number between
_SEPARATOR = re.compile(r"\s*[,;]\s*|\s+")


class UnusableFileError(Exception):
    """The reason why a file gives no numbers, as the end of a sentence."""


def read_numbers(path: str, beside: str, texts: Mapping[str, str]) -> Array:
    """The numbers of a file as (rows, columns); a relative path starts at the folder of `beside`.

    Numbers of a row are separated by commas, semicolons or blanks; empty lines and what follows a
    `#` are left out. `texts` has what was read before, by path. Raises UnusableFileError.
    """
    rows: list[list[float]] = []
    file = number_path(path, beside)
    text = texts[file] if file in texts else number_text(file)
    quotes = is_near(file, beside)
    for number, line in enumerate(text.splitlines(), 1):
        content = line.split("#", 1)[0].strip()
        if not content:
            continue
        row = [_number(cell, number, quotes=quotes) for cell in _SEPARATOR.split(content)]
        if rows and len(row) != len(rows[0]):
            reason = f"line {number} has {len(row)} numbers, the first row {len(rows[0])}"
            raise UnusableFileError(reason)
        rows.append(row)
    if not rows:
        raise UnusableFileError("it has no numbers")
    return np.array(rows)


def number_path(path: str, beside: str) -> str:
    """The file that a spec means, seen from where `beside` is."""
    return os.path.normpath(Path(beside).parent / path)


def number_text(path: str) -> str:
    """Reads a file of numbers. Raises UnusableFileError."""
    if "\0" in path:
        raise UnusableFileError("that is no path")
    file = Path(path)
    try:
        if not file.is_file():  # a pipe or a device would never end
            raise UnusableFileError("it is a folder" if file.is_dir() else "there is no such file")
        refuse_endless(file)
        size = file.stat().st_size
        if size > LARGEST_FILE:
            raise UnusableFileError(f"it has {size:,} bytes, at most {LARGEST_FILE:,} are read")
        # cut again, as a file can grow meanwhile; spreadsheets begin UTF-8 with a byte order mark
        return file.read_bytes()[:LARGEST_FILE].decode("utf-8-sig")
    except UnicodeDecodeError:
        raise UnusableFileError("it is not UTF-8 text") from None
    except OSError as error:
        raise UnusableFileError((error.strerror or str(error)).lower()) from None


def _number(cell: str, line: int, *, quotes: bool) -> float:
    shown = repr(cell[:_QUOTED]) if quotes else "a cell"
    try:
        value = float(cell)
    except ValueError:
        raise UnusableFileError(f"{shown} in line {line} is no number") from None
    if not math.isfinite(value):
        raise UnusableFileError(f"{cell[:_QUOTED]} in line {line} is not finite")
    return value

"""Reads a text file of numbers, one row per line, with limits on size since it is untrusted."""

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
"""Maximum size in bytes; it holds several times more values than the largest array of a program."""

_QUOTED = 40
"""Maximum number of characters of a cell that a message quotes."""
# blanks next to a comma are part of the separator: `1, 2` has no empty cell
_SEPARATOR = re.compile(r"\s*[,;]\s*|\s+")


class UnusableFileError(Exception):
    """The file does not contain usable numbers; the message is the end of a sentence."""


def read_numbers(path: str, beside: str, texts: Mapping[str, str]) -> Array:
    """Reads a file as an array (rows, columns). A relative path starts at the folder of `beside`.

    Commas, semicolons or blanks separate the values of a row. Empty lines and comments (`# …`) are
    skipped. `texts` maps paths to contents that were read before. Raises UnusableFileError.
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
    """The path of a file that a spec names; relative paths start at the folder of the spec,
    `beside`.
    """
    return os.path.normpath(Path(beside).parent / path)


def number_text(path: str) -> str:
    """Reads the text of a file. Raises UnusableFileError."""
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
        # limited again: the file may have grown; spreadsheets start UTF-8 with a byte order mark
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

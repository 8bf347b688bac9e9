"""Finds the array files that initial values name (`init: {file: taps.csv}`) and reads their texts.

A run and a program file save these texts like the specs of sub-models. Later changes of a file do
not change the saved model.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, cast

from compiler.lowering.arrays import UnusableFileError, number_path, number_text
from msnn.model.spec_hash import SubmodelFile
from spec_schema.fields.entry import Entry
from spec_schema.fields.leaf import Located
from spec_schema.reading.reader import ReadResult
from spec_schema.sections.values import Initializer


def number_texts(read: ReadResult, kept: Mapping[str, str] | None = None) -> dict[str, str]:
    """The texts by path: from `kept` if it has the path, else from the file.

    Omits files that cannot be read; the compiler reports them if an expression uses them.
    """
    found: dict[str, str] = {}
    for file in _named(read):
        path = number_path(file.value, file.span.file)
        if kept is not None and path in kept:
            found[path] = kept[path]
            continue
        try:
            found[path] = number_text(path)
        except UnusableFileError:
            continue
    return found


def number_parts(texts: Mapping[str, str]) -> tuple[SubmodelFile, ...]:
    """The array files as parts of a model, numbered in the order in which the spec names them.

    The number comes first in the name. No sub-model's name begins with a digit, so names are
    unique.
    """
    return tuple(
        SubmodelFile(
            name=f"{number}-{Path(path).name}",
            path=os.path.normpath(path),
            text=text,
            weights="",
            is_numbers=True,
        )
        for number, (path, text) in enumerate(texts.items(), 1)
    )


def _named(read: ReadResult) -> Iterator[Located[str]]:
    yield from _in(read.spec)
    for file in read.used.values():
        yield from _named(file)


def _in(value: Any) -> Iterator[Located[str]]:
    match value:
        # before `Entry`, which it is too
        case Initializer(file=Located() as file):
            yield file
        case Entry():
            for field in type(value).model_fields:
                yield from _in(getattr(value, field))
        case tuple() | list():
            for part in cast("tuple[Any, ...]", value):
                yield from _in(part)
        case Mapping():
            for part in cast("Mapping[str, Any]", value).values():
                yield from _in(part)
        case _:
            return

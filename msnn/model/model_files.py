"""Hashes the files that a model was made of, and reads the array files of its initial values.

A run and a program file save these texts like the specs of sub-models. Later changes of a file do
not change the saved model.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

from compiler.lowering.arrays import UnusableFileError, number_path, number_text
from spec_schema.fields.entry import Entry
from spec_schema.fields.leaf import Located
from spec_schema.late_dataclass import dataclass
from spec_schema.reading.reader import ReadResult
from spec_schema.registry import PARTS, PartLine
from spec_schema.sections.values import Initializer


@dataclass(frozen=True, slots=True, kw_only=True)
class SubmodelFile:
    """A file that a model was made of, such as the spec of a sub-model: full name, path and text.

    `weights` is the SHA-256 of its weights file, or "". `file` is that weights file, or None. Other
    kinds are the files of parts, such as a robot (`line` is set), and files of initial values
    (`is_numbers`).
    """

    name: str
    path: str
    text: str
    weights: str
    file: Path | None = None
    line: PartLine | None = None
    is_numbers: bool = False

    def record(self) -> dict[str, str]:
        """The path and hashes of this file as a JSON object for `run.json`."""
        if self.is_numbers:
            digest = _sha256(self.text)
            return {"path": self.path, "numbers_sha256": digest, "kind": NUMBERS}
        return {
            "path": self.path,
            "spec_sha256": _sha256(self.text),
            "weights_sha256": self.weights,
            **({"kind": self.line.key} if self.line else {}),
        }

    @property
    def kept_as(self) -> str:
        """The name under which a run saves a copy of the text in its folder."""
        return kept_name(self.name, self.record())


NUMBERS = "numbers"
"""The word in the record of a file of initial values under `kind`."""
_SUFFIXES = {line.key: line.suffix for line in PARTS} | {NUMBERS: ""}


def kept_name(name: str, record: Mapping[str, str]) -> str:
    """The name of the copy in a run's folder; `record` is the entry of the file in `run.json`."""
    return f"{Path(name).name}{_SUFFIXES.get(record.get('kind', ''), '.msnn.yaml')}"


def parts_of(read: ReadResult, digests: Mapping[str, str]) -> tuple[SubmodelFile, ...]:
    """The files of every sub-model of a spec; `digests` are the SHA-256 of weights by full name."""
    return tuple(_parts(read, digests, ""))


def with_files(
    parts: Sequence[SubmodelFile], files: Mapping[str, Path]
) -> tuple[SubmodelFile, ...]:
    """The same, each with its weights file from `files`, by full name; None for the others."""
    return tuple(replace(part, file=files.get(part.name)) for part in parts)


def hash_of(text: str, parts: Sequence[SubmodelFile], settings: Sequence[str] = ()) -> str:
    """The SHA-256 that identifies a model: of the spec's text, its sub-models and overridden
    values.

    `settings` are values that replace those of the spec, such as `train.0.epochs=5`.
    """
    # as JSON: text and settings run into one another otherwise
    own = _sha256(text) if not settings else _sha256(json.dumps([text, *settings]))
    # so that a plain spec's hash is that of its file, which anybody can check
    if not parts:
        return own
    return _sha256(json.dumps([own, *([p.name, _sha256(p.text), p.weights] for p in parts)]))


def _parts(read: ReadResult, digests: Mapping[str, str], prefix: str) -> Iterator[SubmodelFile]:
    for name, file in read.used.items():
        full = prefix + name
        kind = read.spec.use[name].part
        yield SubmodelFile(
            name=full,
            path=file.source.path,
            text=file.source.text,
            weights=digests.get(full, ""),
            line=kind[0] if kind else None,
        )
        # full names: two parts may both use a sub-model of one name
        yield from _parts(file, digests, f"{full}.")


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def number_texts(read: ReadResult, kept: Mapping[str, str] | None = None) -> dict[str, str]:
    """The text of each file of initial values that a spec names, by path.

    Texts in `kept` are used instead of files. Omits files that cannot be read; the compiler reports
    them if an expression uses them.
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

"""Hashes what a model was made of: the text of its spec, those of its sub-models, weights."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from spec_schema.late_dataclass import dataclass
from spec_schema.reading.reader import ReadResult
from spec_schema.registry import PARTS, PartLine


@dataclass(frozen=True, slots=True, kw_only=True)
class SubmodelFile:
    """A sub-model: its full name, the path and text of its spec, sha256 of its weights or "".

    Of another kind of part, `line`, the text is that of its file. `file` has these weights; None
    where there are none, or only a program has them. A file of initial values is a part too, whose
    text is its numbers.
    """

    name: str
    path: str
    text: str
    weights: str
    file: Path | None = None
    line: PartLine | None = None
    is_numbers: bool = False

    def record(self) -> dict[str, str]:
        """The parts that a run was made of, as data."""
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
        """The name of the file in which a run keeps the text."""
        return kept_name(self.name, self.record())


NUMBERS = "numbers"
"""The word in the record of a file of initial values under `kind`."""
_SUFFIXES = {line.key: line.suffix for line in PARTS} | {NUMBERS: ""}


def kept_name(name: str, record: Mapping[str, str]) -> str:
    """The name of the file in which a run keeps the text of a part, by what its record says."""
    return f"{Path(name).name}{_SUFFIXES.get(record.get('kind', ''), '.msnn.yaml')}"


def parts_of(read: ReadResult, digests: Mapping[str, str]) -> tuple[SubmodelFile, ...]:
    """Every sub-model of a spec; `digests` are those of weights by full name."""
    return tuple(_parts(read, digests, ""))


def with_files(
    parts: Sequence[SubmodelFile], files: Mapping[str, Path]
) -> tuple[SubmodelFile, ...]:
    """The parts with the files of their weights, by full name."""
    return tuple(replace(part, file=files.get(part.name)) for part in parts)


def hash_of(text: str, parts: Sequence[SubmodelFile], settings: Sequence[str] = ()) -> str:
    """sha256 of a spec's text; with sub-models, of what it and they are made of.

    `settings` are those that replace values of the model.
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

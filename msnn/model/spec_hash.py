"""Hashes what a model was made of: the text of its spec, those of its sub-models, weights."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from spec_schema.reading.reader import ReadResult


@dataclass(frozen=True, slots=True, kw_only=True)
class SubmodelFile:
    """A sub-model: its full name, the path and text of its spec, sha256 of its weights or "".

    `file` has these weights; None where there are none, or only a program has them. A file of
    initial values is a part too, which is no spec.
    """

    name: str
    path: str
    text: str
    weights: str
    file: Path | None = None
    is_spec: bool = True

    @property
    def kept_as(self) -> str:
        """What a run calls its copy of the text."""
        return f"{self.name}.msnn.yaml" if self.is_spec else self.name

    def record(self) -> dict[str, str]:
        """What a run was made of, as data."""
        if not self.is_spec:
            return {"path": self.path, "numbers_sha256": _sha256(self.text)}
        return {
            "path": self.path,
            "spec_sha256": _sha256(self.text),
            "weights_sha256": self.weights,
        }


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
    own = _sha256(text) if not settings else _sha256(json.dumps([text, *settings]))
    if not parts:
        return own
    return _sha256(json.dumps([own, *([p.name, _sha256(p.text), p.weights] for p in parts)]))


def _parts(read: ReadResult, digests: Mapping[str, str], prefix: str) -> Iterator[SubmodelFile]:
    for name, file in read.used.items():
        full = prefix + name
        yield SubmodelFile(
            name=full, path=file.source.path, text=file.source.text, weights=digests.get(full, "")
        )
        yield from _parts(file, digests, f"{full}.")


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()

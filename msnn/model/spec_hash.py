"""Hashes what a model was made of: the text of its spec, those of its sub-models, weights."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from spec_schema.late_dataclass import dataclass
from spec_schema.reading.reader import ReadResult


@dataclass(frozen=True, slots=True, kw_only=True)
class SubmodelFile:
    """A sub-model: its full name, the path and text of its spec, sha256 of its weights or "".

    Of a robot the text is its URDF. `file` has these weights; None where there are none, or only a
    program has them. A file of initial values is a part too, whose text is its numbers.
    """

    name: str
    path: str
    text: str
    weights: str
    file: Path | None = None
    is_robot: bool = False
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
            **({"kind": ROBOT} if self.is_robot else {}),
        }

    @property
    def kept_as(self) -> str:
        """The name of the file in which a run keeps the text."""
        return kept_name(self.name, self.record())


ROBOT = "robot"
NUMBERS = "numbers"
"""What the record of a robot, and that of a file of initial values, says under `kind`."""


def kept_name(name: str, record: Mapping[str, str]) -> str:
    """The name of the file in which a run keeps the text of a part, by what its record says."""
    suffixes = {ROBOT: ".urdf", NUMBERS: ""}
    return f"{Path(name).name}{suffixes.get(record.get('kind', ''), '.msnn.yaml')}"


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
        yield SubmodelFile(
            name=full,
            path=file.source.path,
            text=file.source.text,
            weights=digests.get(full, ""),
            is_robot=file.robot is not None,
        )
        # full names: two parts may both use a sub-model of one name
        yield from _parts(file, digests, f"{full}.")


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()

"""Defines the properties of an export that source checks need."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_HASH = re.compile(r"[0-9a-f]{64}")


class Sources(Protocol):
    """A folder with C: `include`, `src`, perhaps `test`."""

    @property
    def folder(self) -> Path: ...

    @property
    def prefix(self) -> str:
        """The prefix of its C names."""
        ...

    @property
    def calibration(self) -> str | None:
        """The variable with parameters for calibration tools; None without calibration."""
        ...

    @property
    def include(self) -> Path: ...

    @property
    def sources(self) -> tuple[Path, ...]: ...

    @property
    def model_sources(self) -> tuple[Path, ...]:
        """The deployed sources, without self-tests."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class CFolder:
    """The files of an export of C."""

    folder: Path

    @property
    def include(self) -> Path:
        return self.folder / "include"

    @property
    def sources(self) -> tuple[Path, ...]:
        return tuple(sorted((self.folder / "src").glob("*.c")))

    @property
    def model_sources(self) -> tuple[Path, ...]:
        """The deployed sources, without self-tests."""
        return tuple(path for path in self.sources if not path.stem.endswith("_selftest"))


def plain_name(text: str) -> str:
    """The text if it is a plain C name; it is used in C code and command lines. ValueError."""
    if not _NAME.fullmatch(text):
        raise ValueError(text)
    return text


def plain_hash(text: str) -> str:
    """The text if it is a SHA-256 in hexadecimal digits; ValueError or TypeError for another."""
    if not _HASH.fullmatch(text):
        raise ValueError(text)
    return text


def includes(model: Sources) -> list[str]:
    """Include options for the export and its vectors."""
    return [f"-I{model.include}", f"-I{model.folder / 'src'}", f"-I{model.folder / 'test'}"]

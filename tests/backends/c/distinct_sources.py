"""Leaves out sources that differ from others in names, numbers and texts alone."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
_TEXT = re.compile(r'"(?:\\.|[^"\\])*"')
_NUMBER = re.compile(r"(?<![\w.])-?(?:0x[\da-fA-F.p+-]+|\d[\w.]*(?:(?<=[eE])[+-]\d+\w*)?)")
_ROW = re.compile(r"(?:\s*0,)+")


def distinct(sources: Iterable[Path]) -> list[Path]:
    """The first of those that a checker of the language cannot tell apart.

    A rule of MISRA C looks at statements, types and where names are declared; what one model is
    called, how many numbers a table has and which ones is the same to it.
    """
    found: dict[str, Path] = {}
    for source in sources:
        found.setdefault(_shape(source), source)
    return list(found.values())


def _shape(source: Path) -> str:
    prefix = re.sub(r"_(about|ffi|params|selftest)$", "", source.stem)
    text = _COMMENT.sub("", source.read_text(encoding="utf-8"))
    text = re.sub(rf"\b{prefix}_", "own_", text)
    text = re.sub(rf"\b{prefix.upper()}_", "OWN_", text)
    text = _NUMBER.sub("0", _TEXT.sub('""', text))
    return _ROW.sub("0,", re.sub(r"\s+", " ", text))

"""Finds the specs named on a command line: files, folders, or standard input."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import typer

from msnn.model.saved_run import DESCRIPTION

STANDARD_INPUT = Path("-")
_ENDINGS = (".msnn.yaml", ".msnn.yml", ".msnn.json")
_MADE = {"build", "runs"}
"""Output folders of msnn; copies of specs in runs are skipped."""


def spec_files(paths: Sequence[Path]) -> Iterator[Path]:
    """Yields every file, and for a folder all specs in and below it, ordered by name.

    The folder of a run counts as one model. Raises BadParameter for a folder without specs.
    """
    for path in paths:
        # the folder of a run is loaded as one model, with the settings that it was trained with
        if path.is_dir() and not (path / DESCRIPTION).is_file():
            found = sorted(_below(path))
            if not found:
                message = f"`{path}` has no file that ends with {', '.join(_ENDINGS)}"
                raise typer.BadParameter(message, param_hint="SPEC")
            yield from found
        else:
            yield path


def _below(folder: Path) -> Iterator[Path]:
    for path in folder.iterdir():
        if path.is_dir():
            # links to folders may lead in a circle, hidden ones are those of tools
            if not path.name.startswith(".") and path.name not in _MADE and not path.is_symlink():
                yield from _below(path)
        elif path.name.endswith(_ENDINGS):
            yield path


def text_of(file: Path) -> str | None:
    """The text of standard input if the file is `-`; None for other files, which are read later."""
    return sys.stdin.read() if file == STANDARD_INPUT else None

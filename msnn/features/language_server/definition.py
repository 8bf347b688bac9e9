"""Finds the declaration of the name at a position, or the file named there."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from msnn.features.language_server.positions import START, Position, TextRange, range_of
from msnn.features.language_server.view import View
from spec_schema.registry import PARTS


@dataclass(frozen=True)
class Definition:
    """The place of a declaration: the path of a file, and a range in it."""

    path: str
    range: TextRange


def definition(view: View, position: Position) -> Definition | None:
    """The declaration of the name at a position, also in a sub-model's file, or the start of a file
    that `use:` names there. None if there is neither.
    """
    cursor = view.cursor(position)
    file = _used_file(view, cursor.path, position) if not cursor.is_key else None
    if file is not None:
        return Definition(file, START)
    word = view.word(position)
    if word is None:
        return None
    # `x.past`: of the name before the dot
    known = view.names.get(word.text) or view.names.get(word.text.rpartition(".")[0])
    if known is None:
        return None
    place = view.place(known)
    path = place.file
    own = path == view.source.path
    source = view.source if own else view.knowledge.sources.get(path)
    return Definition(path, range_of(place, source))


def _used_file(view: View, path: tuple[str, ...], position: Position) -> str | None:
    """The path of the sub-model's or part's file that is named on the line of `position`: `use:
    {plant: plant.msnn.yaml}`, or its key `spec` or `urdf`. None if no such file exists.

    `path` are the keys that lead to the position.
    """
    # `use: {plant: FILE}` and `use: {plant: {spec: FILE}}`
    if path[:1] != ("use",) or (len(path) > 2 and path[-1] not in _KEYS_OF_FILES):
        return None
    line = view.source.line(position.line + 1) if position.line < view.source.line_count else ""
    folder = Path(view.source.path).parent
    # by the line, not by YAML: a line that is being typed need not parse
    for word in line.replace("'", " ").replace('"', " ").replace(",", " ").split():
        name = os.path.normpath(folder / word.strip("{}[]"))
        if "." in word and _is_file(name):
            return name
    return None


_KEYS_OF_FILES = ("spec", *(key for line in PARTS for key in (line.key, line.file)))


def _is_file(name: str) -> bool:
    try:
        return Path(name).is_file()
    except (OSError, ValueError):  # a name that no file can have
        return False

"""Finds the files of a data source: names, patterns and folders, relative to the spec."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from msnn.data.formats.array_columns import NamedArrays
from msnn.data.formats.table_of_formats import SUFFIXES, Format, format_of
from msnn.errors import data_files as errors
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.suggest import nearest
from spec_schema.fields.located import Located
from spec_schema.sections.data.data import Data, Source


@dataclass(frozen=True, slots=True)
class DataFile:
    """One file of a set; `shown` is its name in messages, as short as it can be."""

    path: Path
    shown: str
    source: str
    layout: Source
    arrays: NamedArrays | None = None
    """Arrays of a session in place of a file; `path` only names them."""

    @property
    def format(self) -> Format:
        return format_of(self.path)

    @property
    def is_text(self) -> bool:
        return self.arrays is None and self.format.is_text

    @property
    def keeps_time(self) -> bool:
        """Whether the file itself says when each value was recorded."""
        return self.arrays is None and self.format.keeps_time


def find_files(data: Data, folder: Path, findings: Findings) -> list[DataFile]:
    """The files of all sources in the order of the spec, those of one pattern by name.

    A folder stands for the data files in it. A pattern that matches nothing is an error.
    """
    found: list[DataFile] = []
    for name, source in data.source.items():
        seen: set[Path] = set()
        for pattern in source.files:
            paths = matching(folder, pattern.value)
            if not paths:
                meant = nearest_path(folder, pattern.value)
                findings.report(errors.no_file(pattern.value, str(folder), pattern.span, meant))
            for path in paths:
                if path not in seen:
                    seen.add(path)
                    found.append(DataFile(path, _shown(path, folder), name, source))
    return found


def data_of_files(data: Data, files: Sequence[Path]) -> Data:
    """The section for other files: laid out as its first source, all in the set `data`, not split.

    Rows are not picked by `from`, `to`: these belong to the files of the spec.
    """
    first = next(iter(data.source.values()))
    place = first.place.value
    names = tuple(Located(str(path.absolute()), place) for path in files)
    source = first.model_copy(update={"files": names, "first": None, "last": None})
    update = {"source": {"data": source}, "split": None, "first": None, "last": None}
    return data.model_copy(update=update)


def matching(folder: Path, pattern: str) -> list[Path]:
    """The files that a name, a pattern or a folder stands for."""
    plain = folder / pattern
    if plain.is_dir():
        return sorted(p for p in plain.iterdir() if p.suffix.lower() in SUFFIXES and _is_data(p))
    if plain.is_file():
        return [plain]
    wild = next((i for i, part in enumerate(plain.parts) if set(part) & set("*?[")), None)
    if wild is None:
        return []
    base = Path(*plain.parts[:wild])
    return sorted(filter(_is_data, base.glob("/".join(plain.parts[wild:]))))


def nearest_path(folder: Path, pattern: str) -> str | None:
    """The pattern with its first part that is not there replaced by the most similar one that is.

    None where nothing is similar, or where the rest then matches nothing either.
    """
    parts = Path(pattern).parts
    for place, part in enumerate(parts):
        here = folder.joinpath(*parts[:place])
        if set(part) & set("*?[") and any(here.glob(part)):
            return None
        if (here / part).exists():
            continue
        try:
            near = nearest(part, sorted(path.name for path in here.iterdir()))
        except OSError:
            return None
        meant = Path(*parts[:place], near, *parts[place + 1 :]) if near else None
        return str(meant) if meant is not None and matching(folder, str(meant)) else None
    return None


def _is_data(path: Path) -> bool:
    """A file, or a link that leads nowhere: reading that says so, skipping it would lose data."""
    return path.is_file() or (path.is_symlink() and not path.exists())


def _shown(path: Path, folder: Path) -> str:
    return str(path.relative_to(folder)) if path.is_relative_to(folder) else str(path)

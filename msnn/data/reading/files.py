"""Finds the files of a data source, relative to the spec, and keys that have no effect on them."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from msnn.data.formats.arrays.array_columns import NamedArrays
from msnn.data.formats.table_of_formats import SUFFIXES, FileFormat, format_of, require_reader
from msnn.data.reading.splits import split_source
from msnn.errors.data import files as errors
from msnn.errors.data import rows as row_errors
from msnn.errors.data.rows import unused_key
from msnn.errors.workflow import unknown_set
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings, SpecError
from spec_schema.diagnostics.suggest import nearest
from spec_schema.editors.spec_data import entry_data
from spec_schema.fields.leaf import Located
from spec_schema.reading.reader import refuse_endless
from spec_schema.sections.data import SETS, Data, Layout, Source

GIVEN = "data"
"""The name of the set for data that replace the spec's data, if the user names none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DataFile:
    """One file of a set; `shown` is its name in messages, shortened where possible."""

    path: Path
    shown: str
    source: str
    layout: Source
    arrays: NamedArrays | None = None
    """Arrays of a data frame instead of a file; `path` is then only a name."""
    is_row_group: bool = False
    """True if the file at `path` contains further recordings."""

    @property
    def format(self) -> FileFormat:
        return format_of(self.path)

    @property
    def is_text(self) -> bool:
        return self.arrays is None and self.format.is_text

    @property
    def has_lines(self) -> bool:
        """True if a message may show a line of the file."""
        return self.arrays is None and self.format.has_lines

    @property
    def keeps_time(self) -> bool:
        """True if the file itself stores the time of each value."""
        return self.arrays is None and self.format.keeps_time


def find_files(data: Data, folder: Path, findings: Findings) -> list[DataFile]:
    """The files of all sources in the order of the spec, the files of one pattern by name.

    A folder means the data files in it. A pattern without a match is an error.
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
                # patterns may overlap; twice in one set a record would count double
                if path not in seen:
                    seen.add(path)
                    if (reason := _why_refused(path)) is not None:
                        findings.report(errors.unreadable_file(_shown(path, folder), reason))
                        continue
                    whole = DataFile(
                        path=path, shown=_shown(path, folder), source=name, layout=source
                    )
                    found += _records(whole, source.records or data.records, findings)
    return found


def _records(file: DataFile, records: str | None, findings: Findings) -> list[DataFile]:
    """The file itself, or its row groups if `records: row_group`."""
    if records != "row_group" or file.path.suffix.lower() != ".parquet":
        return [file]
    require_reader(file.path)
    # pyarrow takes long to load: only for those who have such files
    from msnn.data.formats.arrays.parquet_groups import row_groups

    try:
        groups = row_groups(file.path, file.shown)
    except SpecError as error:
        findings.report(*error.diagnostics)
        return []
    return [replace(file, shown=group.file, arrays=group, is_row_group=True) for group in groups]


def data_of_files(data: Data, files: Sequence[Path], data_set: str | None = None) -> Data:
    """A data section for other files as one set without a split; default name is `data`.

    The files have the layout of set `data_set`, else the common layout of all sets. `from` and `to`
    are ignored, because they belong to the spec's files. Raises SpecError if there is no such set,
    or if layouts differ and none is named.
    """
    layout = _layout(data, data_set)
    formats = [format_of(path) for path in files]
    # keys that do not apply to the given files may apply to those of the spec
    unread: dict[str, None] = {}
    if not any(format.is_text for format in formats):
        unread["csv"] = None
    if not any(format.name == "Parquet" for format in formats):
        unread["records"] = None
    names = tuple(Located(str(path.absolute()), layout.place.value) for path in files)
    source = layout.model_copy(update={"files": names, **unread})
    # the split goes as well: all of the given files are one set
    update = {"source": {data_set or GIVEN: source}, "split": None, "first": None, "last": None}
    return data.model_copy(update={**update, **unread})


def _layout(data: Data, data_set: str | None) -> Source:
    """The layout of a set's files, without their names and the selection of rows."""
    plain = {
        name: source.model_copy(update={"files": (), "first": None, "last": None})
        for name, source in data.source.items()
    }
    if data_set is not None:
        made = SETS if data.split is not None else ()
        if data_set not in plain and data_set not in made:
            raise SpecError([unknown_set(data_set, None, dict.fromkeys((*plain, *made)))])
        findings = Findings()
        divided = None
        if data_set not in plain and data.split is not None:
            divided = split_source(tuple(plain), data.split, findings)
        findings.raise_errors()
        return plain[divided or data_set]
    texts = {json.dumps(entry_data(layout), sort_keys=True) for layout in plain.values()}
    if len(texts) > 1:
        raise SpecError([row_errors.sets_differ(tuple(plain), data.place.key)])
    return next(iter(plain.values()))


def matching(folder: Path, pattern: str) -> list[Path]:
    """The files that match a name, a pattern or a folder."""
    plain = folder / pattern
    if plain.is_dir():
        direct = sorted(filter(_is_data, plain.iterdir()))
        ours = [path for path in direct if path.suffix.lower() in SUFFIXES]
        # formats of plug-ins last: a folder that msnn reads has the same files with every plug-in
        return (
            ours
            or sorted(filter(_is_data, plain.rglob("*.parquet")))
            or [path for path in direct if format_of(path).plugin is not None]
        )
    if plain.is_file():
        return [plain]
    # the folders before the first wildcard are taken as they are: they may be absolute, glob() may
    # not
    wild = next((i for i, part in enumerate(plain.parts) if set(part) & set("*?[")), None)
    if wild is None:
        return []
    base = Path(*plain.parts[:wild])
    return sorted(filter(_is_data, base.glob("/".join(plain.parts[wild:]))))


def nearest_path(folder: Path, pattern: str) -> str | None:
    """The pattern with its first missing part replaced by the most similar existing name.

    None if no name is similar, or if the corrected pattern matches nothing either.
    """
    parts = Path(pattern).parts
    for place, part in enumerate(parts):
        here = folder.joinpath(*parts[:place])
        # a pattern that matches something: what is missing lies further down
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


def _why_refused(path: Path) -> str | None:
    """The reason why an existing file cannot be read; None if it can."""
    try:
        if path.exists():
            refuse_endless(path)
    except OSError as error:
        return (error.strerror or str(error)).lower()
    return None


def _is_data(path: Path) -> bool:
    """True for a file and for a broken link: the reader reports it instead of losing data."""
    return path.is_file() or (path.is_symlink() and not path.exists())


def _shown(path: Path, folder: Path) -> str:
    return str(path.relative_to(folder)) if path.is_relative_to(folder) else str(path)


def unused_keys(
    data: Data, files: Sequence[DataFile], sample_time: float | None
) -> Iterator[Diagnostic]:
    """Yields one error for each key that affects no file in its scope."""
    for scope in (data, *data.source.values()):
        yield from _of_text(scope, _scope(scope, "csv", data, files))
        yield from _of_records(scope, _scope(scope, "records", data, files))
        yield from _of_times(scope, data, files, sample_time)
        yield from _of_holes(scope, data, _scope(scope, "gap", data, files))


def _scope(scope: Layout, key: str, data: Data, files: Sequence[DataFile]) -> list[DataFile]:
    """The files that a key applies to; a set's own key overrides the default of all sets."""
    if scope is data:
        return [file for file in files if getattr(file.layout, key) is None]
    return [file for file in files if file.layout is scope]


def _of_text(scope: Layout, files: Sequence[DataFile]) -> Iterator[Diagnostic]:
    if scope.csv is None or not files:
        return
    read = {key for file in files for key in file.format.text_keys}
    for key in ("delimiter", "decimal", "thousands", "comment", "header", "skip"):
        if key in scope.csv.model_fields_set - read:
            reason = f"{files[0].shown} is a file of {files[0].format.name}"
            yield unused_key(f"csv: {{{key}}}", reason, scope.csv.place.value)


def _of_records(scope: Layout, files: Sequence[DataFile]) -> Iterator[Diagnostic]:
    has_groups = any(file.path.suffix.lower() == ".parquet" for file in files)
    if scope.records == "row_group" and files and not has_groups:
        reason = f"{files[0].shown} is a file of {files[0].format.name}, without row groups"
        yield unused_key("records: row_group", reason, scope.place.key)


def _of_holes(scope: Layout, data: Data, files: Sequence[DataFile]) -> Iterator[Diagnostic]:
    methods = {file.layout.resample or data.resample for file in files}
    if scope.gap is not None and files and not methods & {"linear", "nearest"}:
        reason = f"it bounds steps that `resample: linear` fills, and {files[0].shown} has none"
        yield unused_key("gap", reason, scope.place.key)


def unused_without_times(file: DataFile, data: Data) -> Iterator[Diagnostic]:
    """Reports the keys that need times, for a file that may have times and has none."""
    layout = file.layout
    reason = f"{file.shown} has no times without `time:`"
    if (layout.resample or data.resample) == "none":
        yield unused_key("resample: none", reason, layout.place.key)
    if data.join if layout.join is None else layout.join:
        yield unused_key("join: true", reason, layout.place.key)
    if (how := layout.duplicates or data.duplicates) is not None:
        yield unused_key(f"duplicates: {how}", reason, layout.place.key)


def _of_times(
    scope: Layout, data: Data, files: Sequence[DataFile], sample_time: float | None
) -> Iterator[Diagnostic]:
    asked = {
        "resample": "resample: none" if scope.resample == "none" else None,
        "join": "join: true" if scope.join else None,
        "duplicates": f"duplicates: {scope.duplicates}" if scope.duplicates else None,
    }
    for key, text in asked.items():
        mine = _scope(scope, key, data, files)
        if text is None or not mine:
            continue
        if sample_time is None:
            reason = "the rows of a model without `sample_time` are samples by themselves"
            yield unused_key(text, reason, scope.place.key)
        elif not any(file.keeps_time or file.layout.time or data.time for file in mine):
            reason = f"the rows of {mine[0].shown} have no time without `time:`"
            yield unused_key(text, reason, scope.place.key)

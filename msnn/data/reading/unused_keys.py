"""Reports keys of a data section that have no effect on any of its files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from msnn.data.reading.files import DataFile
from msnn.errors.data.formats import unused_key
from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.sections.data import Data, Layout


def unused_keys(
    data: Data, files: Sequence[DataFile], sample_time: float | None
) -> Iterator[Diagnostic]:
    """Yields one error for each key that affects no file in its scope."""
    for scope in (data, *data.source.values()):
        yield from _of_text(scope, _scope(scope, "csv", data, files))
        yield from _of_records(scope, _scope(scope, "records", data, files))
        yield from _of_times(scope, data, files, sample_time)


def _scope(scope: Layout, key: str, data: Data, files: Sequence[DataFile]) -> list[DataFile]:
    """The files that a key applies to; a set's own key overrides the default of all sets."""
    if scope is data:
        return [file for file in files if getattr(file.layout, key) is None]
    return [file for file in files if file.layout is scope]


def _of_text(scope: Layout, files: Sequence[DataFile]) -> Iterator[Diagnostic]:
    if scope.csv is None or not files:
        return
    read = {key for file in files for key in file.format.text_keys}
    for key in ("delimiter", "decimal", "comment", "header", "skip"):
        if key in scope.csv.model_fields_set - read:
            reason = f"{files[0].shown} is a file of {files[0].format.name}"
            yield unused_key(f"csv: {{{key}}}", reason, scope.csv.place.value)


def _of_records(scope: Layout, files: Sequence[DataFile]) -> Iterator[Diagnostic]:
    has_groups = any(file.path.suffix.lower() == ".parquet" for file in files)
    if scope.records == "row_group" and files and not has_groups:
        reason = f"{files[0].shown} is a file of {files[0].format.name}, without row groups"
        yield unused_key("records: row_group", reason, scope.place.key)


def _of_times(
    scope: Layout, data: Data, files: Sequence[DataFile], sample_time: float | None
) -> Iterator[Diagnostic]:
    asked = {"resample": scope.resample == "none", "join": bool(scope.join)}
    for key, text in (("resample", "resample: none"), ("join", "join: true")):
        mine = _scope(scope, key, data, files)
        if not asked[key] or not mine:
            continue
        if sample_time is None:
            reason = "the rows of a model without `sample_time` are samples by themselves"
            yield unused_key(text, reason, scope.place.key)
        elif not any(file.keeps_time or file.layout.time or data.time for file in mine):
            reason = f"the rows of {mine[0].shown} have no time without `time:`"
            yield unused_key(text, reason, scope.place.key)

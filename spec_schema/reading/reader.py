"""Reads a spec: its file, and the files of its sub-models."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from spec_schema.reading.one_file import ReadResult, read_one_spec
from spec_schema.reading.submodel_files import read_used

__all__ = ["ReadResult", "read_spec"]


def read_spec(
    path: str | Path,
    text: str | None = None,
    settings: Sequence[str] = (),
    *,
    texts: Mapping[str, str] | None = None,
    unsaved: Mapping[str, str] | None = None,
) -> ReadResult:
    """The spec in a `.yaml` or `.json` file, or in `text` as if it stood in that file.

    `settings` such as `train.0.epochs=5` replace values. The files of
    sub-models are read too; with `texts`, these are their contents by path. `unsaved` are texts
    that an editor has in place of files, by their real paths.
    Raises SpecError with all diagnostics of the first stage that fails: the file, its YAML, its
    schema together with its expressions, its sub-models.
    """
    result = read_one_spec(path, text, settings)
    used = read_used(result, texts, unsaved)
    of_parts = (one.warnings for one in used.values() if one.part is not None)
    # nobody checks a URDF by itself; warnings of sub-models come with their own check
    warnings = (*result.warnings, *(warning for each in of_parts for warning in each))
    return replace(result, used=used, warnings=warnings)

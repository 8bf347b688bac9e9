"""Reads the files of entries of `validate:` as separate sets."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from spec_schema.editors.spec_data import entry_data
from spec_schema.sections.data import Data, Source
from spec_schema.sections.spec import Spec
from spec_schema.sections.training import Validation

if TYPE_CHECKING:
    from compiler.ir.program import Program, UsedPlugin
    from msnn.data.dataset import Dataset


def file_sets(checks: Sequence[Validation]) -> dict[str, Source]:
    """The files of all entries by set name; entries with equal files and keys share a set.

    A set is named by its patterns. A further set of the same patterns with other keys gets a
    number.
    """
    found: dict[str, Source] = {}
    for check in checks:
        if check.files is not None and set_of(check.files, found) is None:
            patterns = name = ", ".join(pattern.value for pattern in check.files.files)
            number = 1
            while name in found:
                number += 1
                name = f"{patterns} ({number})"
            found[name] = check.files
    return found


def set_of(files: Source, sets: dict[str, Source]) -> str | None:
    """The name of the set with the same files and keys."""
    wanted = _text(files)
    return next((name for name, source in sets.items() if _text(source) == wanted), None)


def load_file_sets(
    program: Program,
    spec: Spec,
    folder: Path,
    recorded: Mapping[str, UsedPlugin | None] | None = None,
) -> dict[str, Dataset]:
    """The recordings of every set by its name, each as a separate dataset without a split.

    Relative paths start in `folder`; `recorded` is that of `load_data`. Raises SpecError with the
    errors in the files of a set.
    """
    from msnn.data.reading.load import load_data
    from msnn.data.reading.row_filter import row_filters

    return {
        name: load_data(
            program, section, folder, row_filters(_with_data(spec, section)), recorded=recorded
        )
        for name, section in file_sections(spec).items()
    }


def file_sections(spec: Spec) -> dict[str, Data]:
    """A data section for every set, with its files only and the defaults of the spec's section."""
    defaults = spec.data or Data.model_construct(place=spec.place, source={})
    return {
        name: defaults.model_copy(update={"source": {name: source}, "split": None})
        for name, source in file_sets(spec.checks).items()
    }


def _with_data(spec: Spec, section: Data) -> Spec:
    return spec.model_copy(update={"data": section})


def _text(source: Source) -> str:
    # by what they say: places of the spec differ in all
    return json.dumps(entry_data(source), sort_keys=True)

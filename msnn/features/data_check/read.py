"""Reads the data of a spec without changes: gaps and missing values are not errors here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from msnn.data.dataset import Dataset
from msnn.data.reading.file_sets import file_sections
from msnn.data.reading.files import data_of_files
from msnn.data.reading.frames import Frames, frame_data
from msnn.data.reading.load import load_data
from msnn.data.reading.row_filter import row_filters
from msnn.errors.commands import no_data_section
from msnn.model.model import Model
from msnn.model.model_data import (
    data_folder,
    plain_layout,
    sources_of,
    told_where_they_were,
)
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.sections.data import Data

# `nan: split` cuts at missing values in place of refusing them; without `split` all is one set
_KEPT: Mapping[str, str | None] = {"nan": "split", "split": None}
"""Overrides of the data section: nothing is refused, and all rows are in one set."""


def read_as_recorded(
    model: Model, files: Sequence[Path] | None, data_root: str | Path | None
) -> Mapping[str, Dataset]:
    """Every data section of the spec: `data`, then the files of entries of `validate`.

    `files` replace all of them, with the layout of `data`. Raises SpecError for invalid files, such
    as text among numbers.
    """
    sections: dict[str, Data] = {}
    if model.spec.data is not None:
        sections["data"] = model.spec.data
        if files:
            sections["data"] = data_of_files(model.spec.data, files)
    if not files:
        sections |= file_sections(model.spec)
    if not sections:
        raise SpecError([no_data_section("a check of data")])
    # diagnostics show lines of the spec and of data files
    with sources_of(model), told_where_they_were(model, data_root):
        return {
            name: _read(model, section, data_root, as_recorded=True)
            for name, section in sections.items()
        }


def read_resampled(
    model: Model, files: Sequence[Path] | None, data_root: str | Path | None
) -> Dataset | None:
    """The section `data` at the sample time; None where the spec resamples nothing."""
    section = model.spec.data
    if section is None or not _resamples(section):
        return None
    if files:
        section = data_of_files(section, files)
    with sources_of(model):
        return _read(model, section, data_root, as_recorded=False)


def frames_as_recorded(model: Model, frames: Frames) -> Dataset:
    """The recordings in frames, with the layout of the section `data`, if there is one."""
    return _framed(model, model.spec.data or plain_layout(model), frames, as_recorded=True)


def frames_resampled(model: Model, frames: Frames) -> Dataset | None:
    """The same at the sample time; None where the spec resamples nothing."""
    section = model.spec.data
    if section is None or not _resamples(section):
        return None
    return _framed(model, section, frames, as_recorded=False)


def _framed(model: Model, section: Data, frames: Frames, *, as_recorded: bool) -> Dataset:
    section = section.model_copy(update=_KEPT)
    filters = row_filters(model.spec.model_copy(update={"data": section}))
    with sources_of(model):
        return frame_data(
            model.program,
            section,
            frames,
            model.spec.place,
            filters,
            split=False,
            as_recorded=as_recorded,
        )


def _read(
    model: Model, section: Data, data_root: str | Path | None, *, as_recorded: bool
) -> Dataset:
    section = section.model_copy(update=_KEPT)
    filters = row_filters(model.spec.model_copy(update={"data": section}))
    folder = data_folder(model, data_root)
    return load_data(model.program, section, folder, filters, as_recorded=as_recorded)


def _resamples(data: Data) -> bool:
    layouts = (data, *data.source.values())
    return any(layout.resample in ("linear", "nearest") for layout in layouts)

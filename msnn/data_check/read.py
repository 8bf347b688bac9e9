"""Reads the data of a spec as they are: gaps and missing values are facts, not yet errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from msnn.data.dataset import Dataset
from msnn.data.formats.table_of_formats import format_of
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
from spec_schema.sections.data.data import Data

# `nan: split` cuts at missing values in place of refusing them; without `split` all is one set
_KEPT: Mapping[str, str | None] = {"nan": "split", "split": None}
"""Nothing is left out or refused, and all is one set."""


def read_as_recorded(
    model: Model, files: Sequence[Path] | None, data_root: str | Path | None
) -> Mapping[str, Dataset]:
    """Every data section of the spec: `data`, then the files of entries of `validate`.

    `files` are read in place of them all, laid out as those of `data`. Raises SpecError for what no
    file may have, such as text among the numbers.
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
            name: _read(model, _as_recorded(section, model), data_root)
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
        return _read(model, section.model_copy(update=_KEPT), data_root)


def frames_as_recorded(model: Model, frames: Frames) -> Dataset:
    """The records of a session, laid out as the section `data` says, if there is one."""
    return _framed(model, _as_recorded(model.spec.data or plain_layout(model), model), frames)


def frames_resampled(model: Model, frames: Frames) -> Dataset | None:
    """The same at the sample time; None where the spec resamples nothing."""
    section = model.spec.data
    if section is None or not _resamples(section):
        return None
    return _framed(model, section.model_copy(update=_KEPT), frames)


def _framed(model: Model, section: Data, frames: Frames) -> Dataset:
    filters = row_filters(model.spec.model_copy(update={"data": section}))
    with sources_of(model):
        return frame_data(model.program, section, frames, model.spec.place, filters, split=False)


def _read(model: Model, section: Data, data_root: str | Path | None) -> Dataset:
    spec = model.spec.model_copy(update={"data": section})
    return load_data(model.program, section, data_folder(model, data_root), row_filters(spec))


def _as_recorded(data: Data, model: Model) -> Data:
    """The section with nothing filled in, left out or refused; streams keep their resampling."""
    # streams have no common rows before they are resampled
    if any(
        _has_streams(pattern.value) for source in data.source.values() for pattern in source.files
    ):
        return data.model_copy(update=_KEPT)
    # gaps and uneven steps are what is to be found: nothing fills them
    source = {name: one.model_copy(update={"resample": None}) for name, one in data.source.items()}
    has_time = data.time is not None or any(one.time is not None for one in source.values())
    how = "none" if has_time and model.program.sample_time is not None else None
    update = {"nan": "split", "resample": how, "source": source, "split": None}
    return data.model_copy(update=update)


def _has_streams(file: str) -> bool:
    return format_of(file).keeps_time


def _resamples(data: Data) -> bool:
    layouts = (data, *data.source.values())
    return any(layout.resample in ("linear", "nearest") for layout in layouts)

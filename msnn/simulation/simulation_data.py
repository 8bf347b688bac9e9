"""Loads the data for a simulation: those of the spec, other files, or data frames."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TypeAlias, cast

from compiler.ir.program import Program
from msnn.data.dataset import Dataset
from msnn.data.reading.files import data_of_files, matching
from msnn.data.reading.frames import Frames, frame_data
from msnn.data.reading.load import load_data
from msnn.data.reading.row_filter import row_filters
from msnn.errors.data.files import no_file
from msnn.model.model import Model
from msnn.model.model_data import plain_layout, read_data, sources_of
from spec_schema.diagnostics.diagnostic import SpecError

GivenData: TypeAlias = "Frames | Sequence[Path | str] | Path | str"


def simulation_data(
    model: Model,
    program: Program,
    data: GivenData | None,
    data_root: str | Path | None,
    data_set: str | None,
) -> Dataset:
    """Loads the data that `program` reads, and those that outputs of the model predict.

    `data` None means the spec's. Other data are one set without a split, named `data` or
    `data_set`; files have the layout of that set. Raises SpecError with all errors in the data.
    """
    if data is None:
        # the data of the spec, with its sets
        return read_data(model, data_root, "simulation", program)
    files = given_files(data)
    with sources_of(model):
        if files is None:
            spec, frames = model.spec, cast("Frames", data)
            filters = row_filters(spec)
            return frame_data(
                program, spec.data, frames, spec.place, filters, whole=model.program, split=False
            )
        # files of a command line are relative to where it is typed, not to the spec
        missing = [file for file in files if not matching(Path.cwd(), str(file))]
        if missing:
            raise SpecError([no_file(str(file), None, None) for file in missing])
        # other files have the columns of the spec's: only what is read of them differs
        section = data_of_files(model.spec.data or plain_layout(model), files, data_set)
        filters = row_filters(model.spec.model_copy(update={"data": section}))
        return load_data(
            program, section, Path.cwd(), filters, model.program, recorded=model.recorded
        )


def given_files(data: GivenData) -> list[Path] | None:
    """The paths if `data` is a path or a list of paths; None if it is data frames."""
    if isinstance(data, str | Path):
        return [Path(data)]
    if isinstance(data, list | tuple):
        items = cast("Sequence[object]", data)
        if items and all(isinstance(item, str | Path) for item in items):
            return [Path(cast("str | Path", item)) for item in items]
    return None

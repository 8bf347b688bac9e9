"""Reads the measured data of a model, and weights that the caller supplies."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from compiler.ir.program import Program
from msnn.data.dataset import Dataset, FloatArray
from msnn.errors.commands import no_data_section
from msnn.errors.data.files import not_on_disk
from msnn.model.model import Model
from msnn.model.weights.weights_file import Weights, weights_path
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError
from spec_schema.sections.data import Data, Source

if TYPE_CHECKING:
    from msnn.data.reading.frames import Frames


def read_data(
    model: Model,
    data_root: str | Path | None,
    purpose: str,
    program: Program | None = None,
) -> Dataset:
    """Loads the measured data that the `data:` section of the spec names, for the signals of
    `program`.

    `program` is the whole model by default. Signals that outputs predict and `program` does not
    read are loaded if a file has a column for them. `purpose` is the word for it in messages.
    Raises SpecError.
    """
    from msnn.data.reading.load import load_data
    from msnn.data.reading.row_filter import row_filters

    if model.spec.data is None:
        raise SpecError([no_data_section(purpose)])
    folder = data_folder(model, data_root)
    # the inner context adds a note to the error, the outer one the lines of the spec
    with sources_of(model), told_where_they_were(model, data_root):
        signals = program or model.program
        filters = row_filters(model.spec)
        found = load_data(
            signals, model.spec.data, folder, filters, model.program, recorded=model.recorded
        )
        # a training sums over rows; others keep a result for each
        if found.is_on_disk and purpose != "training" and found.rows > MOST_ROWS:
            raise SpecError((_too_many_rows(purpose, found.rows),))
        return found


MOST_ROWS = 5_000_000
"""Maximum number of rows from files on disk for a command that holds its results in memory."""


def _too_many_rows(purpose: str, rows: int) -> Diagnostic:
    reason = f"{purpose} holds its results in memory, {rows:,} rows of at most {MOST_ROWS:,}"
    repair = "give it files of its own, `--data FILES`, or a part by `from` and `to`"
    return not_on_disk(reason, None, repair)


@contextmanager
def told_where_they_were(model: Model, data_root: str | Path | None) -> Generator[None]:
    """A context that adds the original folder of the data to errors about missing data of a run.

    A run does not copy its data. Errors pass unchanged if the caller names `data_root`.
    """
    try:
        yield
    except SpecError as error:
        # who says where data are needs no hint
        if model.trained_in is None or data_root is not None:
            raise
        raise SpecError(_elsewhere(error.diagnostics, model.trained_in), error.sources) from None


def _elsewhere(found: Sequence[Diagnostic], trained_in: str) -> list[Diagnostic]:
    """The errors with a note that names the folder from which the run read its data."""
    note = f"the run does not keep its data: it read them from {trained_in}"
    help = "say where they are: `--data-root FOLDER`"
    return [replace(each, notes=(*each.notes, note), help=help) for each in found]


def data_folder(model: Model, data_root: str | Path | None) -> Path:
    return model.folder if data_root is None else Path(data_root)


def measured(
    model: Model, frames: Frames | None, data_root: str | Path | None, purpose: str
) -> Dataset:
    """The dataset from data frames, or from the files that the spec names if `frames` is None."""
    from msnn.data.reading.frames import frame_data
    from msnn.data.reading.row_filter import row_filters

    if frames is None:
        return read_data(model, data_root, purpose)
    spec = model.spec
    with sources_of(model):
        return frame_data(model.program, spec.data, frames, spec.place, row_filters(spec))


def known_in(model: Model, weights: Weights | None) -> Mapping[str, FloatArray]:
    """The values of parameters: the given weights, by default the initial values of the spec.

    Parameters without a known value are absent. Raises SpecError if weights do not fit the model.
    """
    from msnn.model.trained_model import refuse_other_model
    from msnn.model.weights.weights_file import known_weights

    with sources_of(model):
        # arrays in memory do not say what they were trained for
        if isinstance(weights, str | Path):
            refuse_other_model(model, weights_path(weights))
        return known_weights(model.program, weights)


def given_in(model: Model, weights: Weights | None) -> Mapping[str, FloatArray] | None:
    """The given weights, checked against the model; None if none are given."""
    return None if weights is None else known_in(model, weights)


@contextmanager
def sources_of(model: Model) -> Generator[None]:
    """A context that adds the texts of the spec to a SpecError, so that the error can show lines of
    it.
    """
    try:
        yield
    except SpecError as error:
        raise SpecError(error.diagnostics, (*error.sources, *model.sources)) from None


def plain_layout(model: Model) -> Data:
    """A data section whose columns are named like the signals, for frames without `data:` in the
    spec.
    """
    place = model.spec.place
    source = Source.model_construct(place=place, files=())
    return Data.model_construct(place=place, source={"data": source})

"""Reads data from memory instead of files: pandas or polars frames, mappings of arrays."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol, TypeAlias, cast, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from compiler.ir.program import Program, Signal
from msnn.data.dataset import Dataset
from msnn.data.formats.arrays.array_attributes import (
    UnitTexts,
    packing_in,
    packing_of_column,
    unit_beside,
    unit_of_array,
    unit_of_column,
)
from msnn.data.formats.arrays.array_columns import NamedArrays
from msnn.data.formats.written_units import units_line
from msnn.data.reading.columns import LOG_SUFFIX
from msnn.data.reading.files import GIVEN, DataFile
from msnn.data.reading.load import joined_files
from msnn.data.reading.row_filter import RowFilter
from msnn.data.rollout_rows import measured_beside
from msnn.errors.data.rows import other_sample_time, unusable_array
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.fields.leaf import KeyAndValueSpan
from spec_schema.sections.data import Column, ColumnName, Data, Marks, Source


@runtime_checkable
class FrameLike(Protocol):
    """The interface that frames of pandas and polars share."""

    @property
    def columns(self) -> Any: ...

    def __getitem__(self, name: Any, /) -> Any: ...


Frame: TypeAlias = "FrameLike | Mapping[str, ArrayLike]"
Frames: TypeAlias = "Frame | Sequence[Frame] | Mapping[str, Frame | Sequence[Frame]]"
"""One recording, several, or one or several per set: `{"train": [a, b], "val": c}`."""


def frame_data(
    program: Program,
    data: Data | None,
    frames: Frames,
    place: KeyAndValueSpan,
    filters: Mapping[str, RowFilter],
    *,
    whole: Program | None = None,
    split: bool = True,
    as_recorded: bool = False,
) -> Dataset:
    """Recordings in memory, read like the files of the `data` section: columns, units, split, gaps.

    Each frame is one recording. A mapping is one of sets if its values are frames or lists of
    frames, else one of columns. The columns of the first source of `data` apply to all frames; its
    keys about files are ignored.

    A mapping may contain a signal under its own name instead of the spec's columns: an array (rows,
    *shape) in the signal's unit. `whole` is the complete model of which `program` is a part;
    signals that only `whole` predicts are read if a frame has them. Without `split`, recordings
    without a set are in set `data`. `as_recorded` disables resampling.

    Raises SpecError with all errors, and TypeError for objects that are not frames.
    """
    sets = _sets(frames, "train" if split else GIVEN)
    layout = _layout(data, place)
    section = data or Data.model_construct(place=place, source={GIVEN: layout})
    # each recording states where its columns and its time are
    columns, time = {**section.columns, **layout.columns}, layout.time or section.time
    layout = layout.model_copy(update={"columns": {}, "time": None})
    update = {"source": dict.fromkeys(sets, layout), "columns": {}, "time": None}
    section = section.model_copy(update=update)
    # sets that are given are not split again
    if data is None or not split or (isinstance(frames, Mapping) and _is_of_sets(frames)):
        section = section.model_copy(update={"split": None})
    # what the first source says holds for all, as of columns
    condition = next(iter(filters.values()), None)
    more = () if condition is None else condition.signals
    beside = () if whole is None else measured_beside(whole, program)
    signals = {signal.name: signal for signal in (*more, *beside, *program.signals)}
    files: list[DataFile] = []
    findings = Findings()
    for name, records in sets.items():
        for number, frame in enumerate(records):
            shown = f"{name}[{number}]"
            mine = layout.model_copy(update={"columns": columns, "time": time})
            arrays = _arrays(shown, frame)
            if time is None and program.sample_time is not None:
                step = program.sample_time / (layout.every or section.every or 1)
                _report_index_of_other_times(frame, shown, step, findings)
            if isinstance(frame, Mapping):
                arrays, mine = with_whole_signals(arrays, mine, signals.values(), findings)
            files.append(
                DataFile(path=Path(shown), shown=shown, source=name, layout=mine, arrays=arrays)
            )
    findings.raise_errors()
    chosen = {} if condition is None else dict.fromkeys(sets, condition)
    return joined_files(program, section, files, chosen, findings, whole, as_recorded)


def _sets(frames: Frames, alone: str) -> dict[str, list[Frame]]:
    if isinstance(frames, Mapping) and _is_of_sets(frames):
        return {str(name): _records(value) for name, value in frames.items()}
    return {alone: _records(frames)}


def refuse_sets(frames: Frames | None) -> None:
    """Raises TypeError for frames of several sets if the split defines the sets."""
    if isinstance(frames, Mapping) and _is_of_sets(frames):
        message = "folds divide the records of one set: give a frame or a list of frames"
        raise TypeError(message)


def with_training_rows(data: object) -> Frames | None:
    """The frames by set if they include `train`; None for other data."""
    if not isinstance(data, Mapping) or "train" not in data:
        return None
    frames = cast("Mapping[str, Frame | Sequence[Frame]]", data)
    return frames if _is_of_sets(frames) else None


def _is_of_sets(frames: Mapping[Any, Any]) -> bool:
    return bool(frames) and all(_is_records(value) for value in frames.values())


def _is_records(value: object) -> bool:
    if isinstance(value, list | tuple):
        items = cast("Sequence[object]", value)
        return bool(items) and all(map(_is_frame, items))
    return _is_frame(value)


def _is_frame(value: object) -> bool:
    # record arrays have columns by name but no `columns`; plain arrays have neither names
    return isinstance(value, Mapping | FrameLike) and not isinstance(value, np.ndarray)


def _records(value: object) -> list[Frame]:
    records = cast("Sequence[object]", value) if isinstance(value, list | tuple) else (value,)
    for record in records:
        if not _is_frame(record):
            kind = type(record).__name__
            message = f"data is a frame, a mapping of arrays or a list of these, not {kind}"
            raise TypeError(message)
    return cast("list[Frame]", list(records))


def _arrays(shown: str, frame: Frame) -> NamedArrays:
    if isinstance(frame, Mapping):
        keys: dict[str, Any] = {str(key): key for key in frame}

        def entry(name: str) -> Any:
            return cast("Mapping[Any, Any]", frame)[keys[name]]

        return NamedArrays(
            shown,
            tuple(map(str, frame)),
            lambda name: _unmasked(entry(name)),
            unit_texts=lambda name: [*unit_of_array(entry(name)), *unit_beside(keys, name, entry)],
            packing=lambda name: packing_in(getattr(entry(name), "attrs", {})),
        )
    names = _labels(tuple(frame.columns))
    # by position: labels may be numbers, pairs or the same twice
    at = {name: position for position, name in enumerate(names)}
    levels = {name: level for name, level in _index_levels(frame).items() if name not in at}
    names += tuple(levels)

    def column(name: str) -> Any:
        if name in levels:
            return levels[name]
        rows: Any = getattr(frame, "iloc", None)  # of pandas
        return frame[frame.columns[at[name]]] if rows is None else rows[:, at[name]]

    # dates of polars with a zone come as those of UTC without one
    zoned = {name for name in names if getattr(column(name).dtype, "time_zone", None) is not None}
    attributes: Mapping[Any, Any] = getattr(frame, "attrs", {})  # of pandas

    def units(name: str) -> UnitTexts:
        return [*unit_of_array(column(name)), *unit_of_column(attributes, name)]

    def packing(name: str) -> Mapping[str, Any]:
        of_table = packing_of_column(attributes, name)
        return of_table | packing_in(getattr(column(name), "attrs", {}))

    return NamedArrays(
        shown, names, lambda name: _numbers(column(name)), frozenset(zoned), units, packing
    )


def _index_levels(frame: FrameLike) -> dict[str, Any]:
    """The index of a pandas frame as columns, named as pandas names them in Parquet files.

    An unnamed index is a column if it contains dates or durations, not if it counts rows.
    """
    index: Any = getattr(frame, "index", None) if hasattr(frame, "iloc") else None
    levels = [index.get_level_values(level) for level in range(getattr(index, "nlevels", 0))]
    return {
        f"__index_level_{at}__" if level.name is None else str(level.name): level
        for at, level in enumerate(levels)
        if level.name is not None or level.dtype.kind in "mM"
    }


def _report_index_of_other_times(frame: Frame, shown: str, step: float, findings: Findings) -> None:
    """Reports an index of dates or durations whose median step differs from `step` (seconds).

    Without `time:` the index is ignored, and the rows would silently be taken as one sample apart.
    """
    levels = {} if isinstance(frame, Mapping) else _index_levels(frame)
    for name, level in levels.items():
        if len(levels) > 1 or level.dtype.kind not in "mM" or len(level) < 2:
            continue
        seconds = (level - level[0]).total_seconds().to_numpy()
        found = float(np.nanmedian(np.diff(seconds)))
        if abs(found - step) > 0.01 * step:
            findings.report(other_sample_time(file=shown, found=found, expected=step, index=name))


def _labels(columns: Sequence[Any]) -> tuple[str, ...]:
    """The names of columns with a header of two lines.

    `a.b` for the pair (a, b), or `a [km/h]` if the second line contains units.
    """
    pairs = [_levels(column) for column in columns]
    last = [pair[-1] if len(pair) > 1 else "" for pair in pairs]
    has_units = any(last) and units_line(last) is not None
    return tuple(
        f"{'.'.join(filter(None, pair[:-1]))} [{pair[-1]}]"
        if has_units and pair[-1] and len(pair) > 1
        else ".".join(filter(None, pair))
        for pair in pairs
    )


def _levels(label: object) -> tuple[str, ...]:
    if not isinstance(label, tuple):
        return (str(label),)
    texts = map(str, cast("tuple[object, ...]", label))
    # pandas calls the empty cells of a header so
    return tuple("" if text.startswith("Unnamed: ") else text for text in texts)


def _numbers(column: Any) -> NDArray[Any]:
    """The values of a column; NaN for pandas' marker of a missing number."""
    found = np.asarray(column.to_numpy())
    if found.dtype.kind == "O" and getattr(column.dtype, "kind", "O") in "biuf":
        return np.asarray(column.to_numpy(dtype=np.float64, na_value=np.nan))
    return found


def _unmasked(values: ArrayLike) -> NDArray[Any]:
    """The array with masked elements as NaN, or NaT for dates."""
    if not isinstance(values, np.ma.MaskedArray):
        return np.asarray(getattr(values, "magnitude", values))  # numbers of pint
    masked = cast("np.ma.MaskedArray[Any, Any]", values)
    # of what is no number the kind alone is looked at, and refused
    found = np.array(masked.data, np.float64 if masked.dtype.kind in "biu" else None)
    fill = {"f": np.nan, "M": np.datetime64("NaT"), "m": np.timedelta64("NaT")}
    if found.dtype.kind in fill:
        found[np.ma.getmaskarray(masked)] = fill[found.dtype.kind]
    return found


def _layout(data: Data | None, place: KeyAndValueSpan) -> Source:
    if data is None:
        return Source.model_construct(place=place, files=())
    first = next(iter(data.source.values()))
    return first.model_copy(update={"files": (), "first": None, "last": None})


def with_whole_signals(
    arrays: NamedArrays, layout: Source, signals: Iterable[Signal], findings: Findings
) -> tuple[NamedArrays, Source]:
    """The arrays of a mapping, and a layout in which each signal refers to existing columns.

    A signal without the spec's columns uses the array with its own name, (rows, *shape). Without
    the spec's time column, rows are one sample apart.
    """
    columns, flat = dict(layout.columns), set[str]()
    for signal in signals:
        name = signal.name.removesuffix(LOG_SUFFIX)
        column = layout.columns.get(signal.name, layout.columns.get(name))
        # `x.meas` before `x`, as the log of a state is meant
        own = next((n for n in (signal.name, name) if n in arrays.names), None)
        if own is None or (column is not None and _has(arrays, column)):
            continue
        shape = tuple(axis.size for axis in signal.axes)
        found = arrays.get(own).shape
        if found[1:] != shape:
            reason = f"its shape {found} is not (rows, {', '.join(map(str, shape))})"
            # a scalar may lie as (rows, 1) or (1, rows), which `_column` takes
            if shape or not _is_column(found):
                user = f"`{signal.name}`"
                findings.report(unusable_array(own, arrays.file, user, reason))
                continue
        columns[signal.name] = _whole(
            own, shape, layout, None if column is None else column.missing
        )
        if shape:
            flat.add(own)
    time = layout.time
    if time is not None and not arrays.has(time.column.column):
        time = None
    layout = layout.model_copy(update={"columns": columns, "time": time})
    return replace(arrays, get=_flattened(arrays.get, flat)), layout


def _has(arrays: NamedArrays, column: Column) -> bool:
    return all(arrays.has(part.column) for part in column.column)


def _is_column(shape: tuple[int, ...]) -> bool:
    """True if an array has one value per row: shape (n,), (n, 1) or (1, n)."""
    return len(shape) == 1 or (len(shape) == 2 and 1 in shape)


def _whole(name: str, shape: tuple[int, ...], layout: Source, missing: Marks | None) -> Column:
    """The columns of one array: `q[0]`, `q[1]`, …, or `q` itself for a scalar."""
    names = [f"{name}[{i}]" for i in range(math.prod(shape))] if shape else [name]
    # C order, as `Feed.series` puts columns together again
    parts = tuple(ColumnName(part, layout.place.value) for part in names)
    return Column.model_construct(place=layout.place, column=parts, missing=missing)


def _flattened(
    get: Callable[[str], NDArray[Any]], names: set[str]
) -> Callable[[str], NDArray[Any]]:
    def flattened(name: str) -> NDArray[Any]:
        array = np.asarray(get(name))
        return array.reshape(len(array), -1) if name in names else array

    return flattened

"""Reads channels of ASAM MDF files with asammdf; each channel has the times of its group."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from asammdf import MDF
from asammdf.blocks.utils import MdfException

from msnn.data.dataset import FloatArray
from msnn.data.formats.arrays.array_columns import NamedArrays
from msnn.data.formats.streams.stream_columns import stream_columns
from msnn.data.formats.table import ColumnKey, Streams, TimeSource, WantedColumns
from msnn.data.formats.text.csv_header import Dialect
from msnn.data.formats.written_units import StatedUnit
from msnn.errors.data import files as errors
from msnn.errors.data import rows
from msnn.errors.data.files import unread_part
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError

# it prints lines of its own beside the message of the command
logging.getLogger("asammdf").setLevel(logging.CRITICAL + 1)

_IN_GROUP = re.compile(r"(?P<name>.+)@(?P<group>[0-9]{1,6})")


def read(path: Path, shown: str, wanted: WantedColumns, dialect: Dialect) -> Streams:
    """The requested channels, with their conversions to physical values applied.

    A name that occurs in several channel groups needs the group number: `speed@2`. Times count from
    the start of the measurement, unless the spec names a time channel of the same group. Raises
    SpecError with all errors of the file.
    """
    del dialect  # lays out text
    try:
        with MDF(path) as file:
            # an index counts along the values, not the channels that hold times
            names = _names(file)
            units: dict[ColumnKey, StatedUnit] = {}
            times = _times(file, shown, wanted.time, names, units)

            def find(key: str) -> tuple[FloatArray, NamedArrays] | None:
                found = _channel(file, shown, key)
                return found if found is None or times is None else (times(key), found[1])

            streams = stream_columns(shown, wanted, names, find)
            return replace(streams, time_units=units, warnings=_short_groups(file, shown))
    except (OSError, MdfException, ValueError, IndexError) as error:
        raise SpecError((errors.unreadable_file(shown, errors.reason_of(error, path)),)) from error


def _short_groups(file: Any, shown: str) -> tuple[Diagnostic, ...]:
    """Warnings about groups whose data end before the number of records that they state."""
    found: list[Diagnostic] = []
    for number, group in enumerate(file.groups):
        about = group.channel_group
        size = about.samples_byte_nr + getattr(about, "invalidation_bytes_nr", 0)
        stored = sum(block.original_size for block in group.get_data_blocks())
        # records of unsorted groups have sizes of their own
        if group.sorted and size and stored < size * about.cycles_nr:
            reason = f"group {number} states {about.cycles_nr} records, its data have "
            found.append(unread_part(shown, f"{reason}{stored // size}"))
    return tuple(found)


def _names(file: Any) -> list[str]:
    """The names of the channels, without the time channels of the groups."""
    masters = {file.groups[g].channels[i].name for g, i in file.masters_db.items()}
    return [name for name in file.channels_db if name not in masters]


def _times(
    file: Any,
    shown: str,
    column: TimeSource | None,
    names: Sequence[str],
    units: dict[ColumnKey, StatedUnit],
) -> Callable[[str], FloatArray] | None:
    """A function that returns the times of a channel from the time channel named in the spec.

    Adds the units of these times to `units` if the file states them.
    """
    if column is None:
        return None
    key = column.column
    wanted = key if isinstance(key, str) else names[key] if key < len(names) else None
    if wanted is None or not _places(file, wanted):
        known, place = tuple(file.channels_db), column.place
        missing = errors.missing_columns({str(key): "`time`"}, shown, known, place, numbers=False)
        raise SpecError((missing,))

    def times(name: str) -> FloatArray:
        ((group, _),) = _places(file, name)
        place = next((place for place in _places(file, wanted) if place[0] == group), None)
        if place is None:
            span = column.place
            raise SpecError((rows.time_of_another_group(wanted, shown, name, span),))
        signal = file.get(None, group=group, index=place[1])
        unit = [(str(signal.unit or ""),)]
        arrays = NamedArrays(
            shown,
            (wanted,),
            lambda _: np.asarray(signal.samples),
            unit_texts=lambda _: unit,
            other_names=_names(file),
            other_units=partial(_units, file),
        )
        table = arrays.table(WantedColumns({wanted: "`time`"}, moments=frozenset({wanted})))
        if wanted in table.units:
            units[name] = table.units[wanted]
        return table.columns[wanted]

    return times


def _units(file: Any) -> list[str]:
    """The units of the channels that state one, without the time channels."""
    found: list[str] = []
    for number, group in enumerate(file.groups):
        for index, channel in enumerate(group.channels):
            # the program that writes the file gives times their `s`
            if index != file.masters_db.get(number):
                unit = channel.unit or (channel.conversion.unit if channel.conversion else "")
                found += [str(unit)] if unit else []
    return found


def _places(file: Any, key: str) -> list[tuple[int, int]]:
    """(group, index) of each channel with this name."""
    found = _IN_GROUP.fullmatch(key)
    # a channel may have an `@` in its own name
    name = found["name"] if found and key not in file.channels_db else key
    places = list(file.channels_db.get(name, ()))
    if found and name != key:
        places = [place for place in places if place[0] == int(found["group"])]
    return places


def _channel(file: Any, shown: str, key: str) -> tuple[FloatArray, NamedArrays] | None:
    places = _places(file, key)
    if not places:
        return None
    if len(places) > 1:
        groups = ", ".join(f"`{key}@{group}`" for group, _ in places)
        raise SpecError((errors.duplicate_column(key, shown, None, f"choose one of {groups}"),))
    ((group, index),) = places
    signal = file.get(None, group=group, index=index)
    values = np.asarray(signal.samples)
    unit = [(str(signal.unit or ""),)]
    arrays = NamedArrays(
        shown,
        (key,),
        lambda _: values,
        unit_texts=lambda _: unit,
        other_names=_names(file),
        other_units=partial(_units, file),
    )
    return np.asarray(signal.timestamps, np.float64), arrays

"""Reads channels from ASAM MDF measurements with asammdf; each has the times of its group."""

from __future__ import annotations

import logging
import re
from pathlib import Path
from typing import Any

import numpy as np
from asammdf import MDF
from asammdf.blocks.utils import MdfException

from msnn.data.dataset import FloatArray
from msnn.data.formats.arrays.array_columns import NamedArrays
from msnn.data.formats.streams.stream_columns import stream_columns
from msnn.data.formats.table import Streams, WantedColumns
from msnn.data.formats.text.csv_header import Dialect
from msnn.errors.data import files as errors
from spec_schema.diagnostics.diagnostic import SpecError

# it prints lines of its own beside the message of the command
logging.getLogger("asammdf").setLevel(logging.CRITICAL + 1)

_IN_GROUP = re.compile(r"(?P<name>.+)@(?P<group>[0-9]{1,6})")


def read(path: Path, shown: str, wanted: WantedColumns, dialect: Dialect) -> Streams:
    """The wanted channels with their conversions to physical values applied.

    A name that several channel groups have is written with the group, `speed@2`. Times count from
    the start of the measurement. Raises SpecError with everything that is wrong.
    """
    del dialect  # lays out text
    try:
        with MDF(path) as file:
            # an index counts along the values, not the channels that hold times
            names = [name for name in file.channels_db if name not in _masters(file)]
            return stream_columns(shown, wanted, names, lambda key: _channel(file, shown, key))
    except (OSError, MdfException, ValueError, IndexError, MemoryError) as error:
        raise SpecError((errors.unreadable_file(shown, str(error)),)) from error


def _masters(file: Any) -> set[str]:
    """The names of the channels that hold the times of the others."""
    return {file.groups[g].channels[i].name for g, i in file.masters_db.items()}


def _channel(file: Any, shown: str, key: str) -> tuple[FloatArray, NamedArrays] | None:
    found = _IN_GROUP.fullmatch(key)
    # a channel may have an `@` in its own name
    name = found["name"] if found and key not in file.channels_db else key
    places = list(file.channels_db.get(name, ()))
    if found and name != key:
        places = [place for place in places if place[0] == int(found["group"])]
    if not places:
        return None
    if len(places) > 1:
        groups = ", ".join(f"`{name}@{group}`" for group, _ in places)
        raise SpecError((errors.duplicate_column(name, shown, None, f"choose one of {groups}"),))
    ((group, index),) = places
    signal = file.get(name, group=group, index=index)
    values = np.asarray(signal.samples)
    return np.asarray(signal.timestamps, np.float64), NamedArrays(shown, (key,), lambda _: values)

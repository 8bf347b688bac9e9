"""Reads fields of messages from ROS 1 and ROS 2 bags with rosbags."""

from __future__ import annotations

import re
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.typesys import Stores, TypesysError, get_typestore

from msnn.data.dataset import FloatArray
from msnn.data.formats.arrays.array_columns import NamedArrays
from msnn.data.formats.streams.rosbag_units import field_unit
from msnn.data.formats.streams.stream_columns import stream_columns
from msnn.data.formats.table import Streams, WantedColumns
from msnn.data.formats.text.csv_header import Dialect
from msnn.errors.data import files as errors
from spec_schema.diagnostics.diagnostic import SpecError

_STEP = re.compile(r"(?P<field>\w+)(?:\[(?P<index>[0-9]{1,6})\])?", re.ASCII)


@dataclass(slots=True)
class _Channel:
    """One field of a topic's messages, as `/imu.linear_acceleration.x` or `/joints.position[2]`."""

    topic: str
    path: tuple[tuple[str, int | None], ...]
    time: list[float] = field(default_factory=list[float])
    values: list[float] = field(default_factory=list[float])
    unit: str = ""

    def take(self, seconds: float, message: Any) -> None:
        for name, index in self.path:
            # the first that has one: `angular_velocity` of an IMU, not its x
            if not self.time and not self.unit:
                self.unit = field_unit(message.__msgtype__, name)
            # only names that `_channel` has admitted, none of which begins with an underscore
            message = getattr(message, name)
            if index is not None:
                message = message[index]
        self.time.append(seconds)
        self.values.append(float(message))


def read(path: Path, shown: str, wanted: WantedColumns, dialect: Dialect) -> Streams:
    """The wanted fields; the time of a message is when it was recorded, from the bag's start.

    Raises SpecError with everything that is wrong.
    """
    del dialect  # lays out text
    # the types of a bag without definitions of its own, as old ROS 2 recorders leave it
    types = get_typestore(Stores.LATEST)
    try:
        with AnyReader([path], default_typestore=types) as bag:
            topics = tuple(dict.fromkeys(connection.topic for connection in bag.connections))
            keys = [str(key) for key in wanted.users]
            channels = {key: c for key in keys if (c := _channel(key, topics)) is not None}
            _fill(bag, channels)
    except (OSError, AnyReaderError, TypesysError, ValueError, struct.error, KeyError) as error:
        raise SpecError((errors.unreadable_file(shown, str(error) or "it is broken"),)) from error
    # a field that the message does not have, or an index into what is no list
    except (AttributeError, TypeError, IndexError) as error:
        reason = f"a message has no such field: {error}"
        raise SpecError((errors.unreadable_file(shown, reason),)) from error

    def find(key: str) -> tuple[FloatArray, NamedArrays] | None:
        channel = channels.get(key)
        if channel is None:
            return None
        values = np.array(channel.values)
        unit = (channel.unit,)
        arrays = NamedArrays(shown, (key,), lambda _: values, unit_texts=lambda _: unit)
        return np.array(channel.time), arrays

    return stream_columns(shown, wanted, topics, find)


def _channel(key: str, topics: Sequence[str]) -> _Channel | None:
    # the longest: `/imu` and `/imu.raw` may both be there
    topic = max((t for t in topics if key.startswith(f"{t}.")), key=len, default=None)
    if topic is None:
        return None
    path: list[tuple[str, int | None]] = []
    for step in key.removeprefix(f"{topic}.").split("."):
        found = _STEP.fullmatch(step)
        if found is None or found["field"].startswith("_"):
            return None
        path.append((found["field"], None if found["index"] is None else int(found["index"])))
    return _Channel(topic, tuple(path))


def _fill(bag: AnyReader, channels: dict[str, _Channel]) -> None:
    topics = {channel.topic for channel in channels.values()}
    # other topics are not even decoded: images are most of a bag
    connections = [c for c in bag.connections if c.topic in topics]
    for connection, nanoseconds, raw in bag.messages(connections) if connections else ():
        message = bag.deserialize(raw, connection.msgtype)
        # subtracted as integers
        seconds = (nanoseconds - bag.start_time) * 1e-9
        for channel in channels.values():
            if channel.topic == connection.topic:
                channel.take(seconds, message)

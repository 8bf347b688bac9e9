"""Reads message fields from ROS 1 and ROS 2 bags with rosbags."""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from sqlite3 import connect
from typing import Any, TypeAlias

import numpy as np
from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.typesys import Stores, TypesysError, get_typestore

from msnn.data.dataset import FloatArray
from msnn.data.formats.arrays.array_columns import NamedArrays
from msnn.data.formats.streams.rosbag_units import field_unit
from msnn.data.formats.streams.stream_columns import stream_columns
from msnn.data.formats.table import Streams, TimeSource, WantedColumns
from msnn.data.formats.text.csv_header import Dialect
from msnn.errors.data import files as errors
from msnn.errors.data import rows
from msnn.errors.data.cells import unit_of_moments
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.expressions.moments import Moment

_STEP = re.compile(r"(?P<field>\w+)(?:\[(?P<index>[0-9]{1,6})\])?", re.ASCII)
_DAY = 86_400 * 10**9
"""Nanoseconds; a clock further from the recorder's clock is a different one, such as a
simulator's.
"""

_Path: TypeAlias = tuple[tuple[str, int | None], ...]
"""Field names, each with the index of an element if the field is a list."""


@dataclass(slots=True)
class _Channel:
    """One field of a topic's messages, such as `/imu.linear_acceleration.x` or
    `/joints.position[2]`.
    """

    topic: str
    path: _Path
    clock: _Path | None = None
    """The field with the time of a message; None to use the time of recording."""
    time: list[float] = field(default_factory=list[float])
    values: list[float] = field(default_factory=list[float])
    unit: str = ""

    def take(self, recorded: int, begin: int, message: Any) -> None:
        if not self.values:
            self.unit = _unit(message, self.path)
        self.values.append(float(_field(message, self.path)))
        if self.clock is not None:
            stamp = _field(message, self.clock)
            if not hasattr(stamp, "nanosec"):
                self.time.append(float(stamp))
                return
            recorded = _nanoseconds(stamp)
        # subtracted as integers
        self.time.append((recorded - begin) * 1e-9)


def _nanoseconds(stamp: Any) -> int:
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def _field(message: Any, path: _Path) -> Any:
    for name, index in path:
        # only names that `_path` has admitted, none of which begins with an underscore
        message = getattr(message, name)
        if index is not None:
            message = message[index]
    return message


def _unit(message: Any, path: _Path) -> str:
    """The unit of a field, from the outermost field with a unit: `angular_velocity`, not its
    `x`.
    """
    for number, (name, _) in enumerate(path):
        unit = field_unit(_field(message, path[:number]).__msgtype__, name)
        if unit:
            return unit
    return ""


def read(path: Path, shown: str, wanted: WantedColumns, dialect: Dialect) -> Streams:
    """The requested fields; by default, times are times of recording, counted from the bag's start.

    `time: header.stamp` uses the stamp of every topic that has one, `time: /imu.header.stamp` that
    of one topic. Stamps count from the bag's start too. A numeric field can be the time of its own
    topic only. Raises SpecError with all errors of the file.
    """
    del dialect  # lays out text
    # the types of a bag without definitions of its own, as old ROS 2 recorders leave it
    types = get_typestore(Stores.LATEST)
    try:
        _check_database(path)
        with AnyReader([path], default_typestore=types) as bag:
            topics = tuple(dict.fromkeys(connection.topic for connection in bag.connections))
            keys = [str(key) for key in wanted.users]
            channels = {key: c for key in keys if (c := _channel(key, topics)) is not None}
            begin: Moment | None = Moment(bag.start_time, has_zone=True)
            if wanted.time is not None and channels:
                begin = _set_clocks(bag, channels, topics, wanted.time, shown)
            _fill(bag, channels, 0 if begin is None else begin.nanoseconds, shown)
    except (OSError, AnyReaderError, TypesysError, ValueError, struct.error, KeyError) as error:
        raise SpecError((errors.unreadable_file(shown, errors.reason_of(error, path)),)) from error
    # a field that the message does not have, or an index into what is no list
    except (AttributeError, TypeError, IndexError) as error:
        reason = f"a message has no such field: {error}"
        raise SpecError((errors.unreadable_file(shown, reason),)) from error

    def find(key: str) -> tuple[FloatArray, NamedArrays] | None:
        channel = channels.get(key)
        if channel is None:
            return None
        values = np.array(channel.values)
        unit = [(channel.unit,)]
        arrays = NamedArrays(shown, (key,), lambda _: values, unit_texts=lambda _: unit)
        return np.array(channel.time), arrays

    return replace(stream_columns(shown, wanted, topics, find), begins=begin)


def _check_database(path: Path) -> None:
    """Raises ValueError if a database has damaged pages, of which SQLite may pass over rows."""
    if path.suffix.lower() != ".db3" or not path.is_file():
        return
    # no file is written beside it
    with closing(connect(f"{path.absolute().as_uri()}?mode=ro&immutable=1", uri=True)) as base:
        ((found,),) = base.execute("PRAGMA integrity_check(1)").fetchall()
    if found != "ok":
        raise ValueError(found)


def _set_clocks(
    bag: AnyReader,
    channels: Mapping[str, _Channel],
    topics: Sequence[str],
    column: TimeSource,
    shown: str,
) -> Moment | None:
    """Assigns the time field named in the spec to channels of its topic, or of all topics.

    Returns time 0: the bag's start, the first stamp of a simulated clock, or None for numbers.
    """
    key, span = str(column.column), column.place
    topic, path = _split(key, topics)
    examples: dict[str, Any] = {}
    stamps: list[int] = []
    for channel in channels.values():
        if path is None or topic not in (None, channel.topic):
            continue
        if channel.topic not in examples:
            examples[channel.topic] = _first(bag, channel.topic)
        example = examples[channel.topic]
        try:
            stamp = None if example is None else _field(example, path)
        except (AttributeError, TypeError, IndexError):
            continue
        channel.clock = path
        if hasattr(stamp, "nanosec"):
            if column.unit is not None:
                text = column.unit.value.text
                raise SpecError((unit_of_moments(key, text, column.unit.span),))
            stamps.append(_nanoseconds(stamp))
            continue
        # numbers may begin anywhere: they cannot be compared with times of other topics
        other = next((n for n, c in channels.items() if c.topic != channel.topic), None)
        if other is not None:
            raise SpecError((rows.time_of_another_group(key, shown, other, span),))
    if all(channel.clock is None for channel in channels.values()):
        if topic is not None and topic not in {channel.topic for channel in channels.values()}:
            other = next(iter(channels))
            raise SpecError((rows.time_of_another_group(key, shown, other, span),))
        missing = errors.missing_columns({key: "`time`"}, shown, topics, span, numbers=False)
        raise SpecError((missing,))
    if not stamps:
        return None
    is_simulated = len(stamps) == len(channels) and abs(min(stamps) - bag.start_time) > _DAY
    return Moment(min(stamps) if is_simulated else bag.start_time, has_zone=not is_simulated)


def _first(bag: AnyReader, topic: str) -> Any:
    """The first message of a topic; None if the topic has no messages."""
    connections = [c for c in bag.connections if c.topic == topic]
    for connection, _, raw in bag.messages(connections):
        return bag.deserialize(raw, connection.msgtype)
    return None


def _channel(key: str, topics: Sequence[str]) -> _Channel | None:
    topic, path = _split(key, topics)
    return None if topic is None or path is None else _Channel(topic, path)


def _split(key: str, topics: Sequence[str]) -> tuple[str | None, _Path | None]:
    """The topic and the field path of a column name; None for parts that do not exist."""
    # the longest: `/imu` and `/imu.raw` may both be there
    topic = max((t for t in topics if key.startswith(f"{t}.")), key=len, default=None)
    path: list[tuple[str, int | None]] = []
    for step in (key if topic is None else key.removeprefix(f"{topic}.")).split("."):
        found = _STEP.fullmatch(step)
        if found is None or found["field"].startswith("_"):
            return topic, None
        path.append((found["field"], None if found["index"] is None else int(found["index"])))
    return topic, tuple(path)


def _fill(bag: AnyReader, channels: dict[str, _Channel], begin: int, shown: str) -> None:
    topics = {channel.topic for channel in channels.values()}
    # other topics are not decoded: images make up most of a bag
    connections = [c for c in bag.connections if c.topic in topics]
    found = 0
    for connection, nanoseconds, raw in bag.messages(connections) if connections else ():
        found += 1
        message = bag.deserialize(raw, connection.msgtype)
        for channel in channels.values():
            if channel.topic == connection.topic:
                channel.take(nanoseconds, begin, message)
    # rosbags passes over damaged records; a bag may state no numbers
    stated = sum(connection.msgcount for connection in connections)
    if stated not in (0, found):
        reason = f"it is damaged: it states {stated} messages of these topics, and has {found}"
        raise SpecError((errors.unreadable_file(shown, reason),))

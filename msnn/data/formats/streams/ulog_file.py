"""Reads topics of PX4's ULog files with pyulog; each topic has the times of its messages."""

from __future__ import annotations

import io
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyulog import ULog

from msnn.data.dataset import FloatArray
from msnn.data.formats.arrays.array_attributes import PackingError
from msnn.data.formats.arrays.array_columns import NamedArrays
from msnn.data.formats.streams.stream_columns import stream_columns
from msnn.data.formats.table import ColumnKey, Streams, TimeSource, WantedColumns
from msnn.data.formats.text.csv_header import Dialect
from msnn.data.formats.written_units import StatedUnit
from msnn.errors.data import files as errors
from msnn.errors.data import rows
from msnn.errors.data.files import lost_messages, start_in_doubt, unread_part
from msnn.errors.data.rows import listed
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError
from spec_schema.units.parser import parse_unit

_KINDS = frozenset(b"BFIMPQARDLCSO")
"""The kinds of messages that ULog defines; others may belong to a later version."""
_PADDING = "_padding"
"""Beginning of the names of fields without meaning."""
_TIME = "timestamp"
_STAMP = "uint64_t"
_LATEST = 1 << 62
"""Microseconds; a later time is a damaged one."""
_EXACT = 1 << 53
"""Microseconds; the seconds of a longer time are rounded to more than a microsecond."""
_LONGEST = 366 * 86_400_000_000
"""Maximum time in microseconds between the start of a log and a message: a year."""
_REPAIR = (
    'its readable messages become a new file by `python -c "from '
    "msnn.data.formats.streams.ulog_file import Log; Log('OLD.ulg').write_ulog('NEW.ulg')\"`"
)


class _LogFile(io.BufferedReader):
    """A file that notes what pyulog passes over silently: a cut end, and unknown messages.

    pyulog reads each message in two parts, and seeks where it searches for the next one.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(io.FileIO(path))
        self.is_cut = False
        self.unknown: Counter[str] = Counter()
        # the file begins with a header of its own
        self._is_header = self._is_search = False

    def read(self, size: int | None = -1, /) -> bytes:
        found = super().read(size)
        if not self._is_search and size is not None:
            if len(found) < size:
                self.is_cut = bool(found) or not self._is_header
            elif self._is_header and found[-1] not in _KINDS:
                self.unknown[chr(found[-1])] += 1
        self._is_header, self._is_search = not self._is_header, False
        return found

    def seek(self, target: int, whence: int = 0, /) -> int:
        self._is_header, self._is_search = True, whence == 1
        return super().seek(target, whence)


class _Subscriptions(dict[Any, Any]):
    """Topics by the number that their messages have.

    pyulog takes all of them out at the end of each part of a file, and forgets the messages of a
    number that a second subscription uses again.
    """

    def __init__(self) -> None:
        super().__init__()
        self.known: dict[int, Any] = {}

    def __setitem__(self, number: int, topic: Any) -> None:
        before = self.pop(number, None)
        if before is not None and before.buffer:
            super().__setitem__((number, len(self)), before)
        super().__setitem__(number, topic)
        self.known[number] = topic

    def popitem(self) -> tuple[Any, Any]:
        # in the order of the file
        number = next(iter(self))
        return number, self.pop(number)

    def begin_part(self) -> None:
        """Subscribes to the topics of the parts before."""
        for number, topic in self.known.items():
            again = copy(topic)
            again.buffer = bytearray()
            super().__setitem__(number, again)


class Log(ULog):
    """A log whose appended parts use the subscriptions of the parts before them.

    Appended parts hold any messages of the section of data, and their subscriptions are those of
    the log (https://docs.px4.io/main/en/dev_log/ulog_file_format.html). pyulog begins each part
    without any. `write_ulog` of this class writes the messages of all parts to a new file.
    """

    def __init__(self, file: Any) -> None:
        self.stopped_at: int | None = None
        """The position of a message at which pyulog gives up; None if it reads all messages."""
        super().__init__(file)
        # two topics may have used one number, which a new file may not
        for number, data in enumerate(self.data_list):
            data.msg_id = number

    def _read_file_data(self, message_name_filter_list: Any, read_until: int | None = None) -> None:
        log: Any = self
        if not isinstance(log._subscriptions, _Subscriptions):
            log._subscriptions = _Subscriptions()
        log._subscriptions.begin_part()
        super()._read_file_data(message_name_filter_list, read_until)
        file = log._file_handle
        end = file.tell()
        is_early = end < file.seek(0, 2) if read_until is None else end <= read_until
        file.seek(end)
        if is_early and self.stopped_at is None:
            self.stopped_at = end


@dataclass(frozen=True, slots=True)
class _Topic:
    """The messages of one instance of a topic."""

    name: str
    instance: int
    arrays: Mapping[str, NDArray[Any]]
    types: Mapping[str, str]
    """The type of each field, such as `float`."""

    @property
    def label(self) -> str:
        return f"{self.name}_{self.instance}"


def read(path: Path, shown: str, wanted: WantedColumns, dialect: Dialect) -> Streams:
    """The requested fields: `vehicle_attitude.q[0]`, `sensor_accel_1.x` of the second instance.

    Times are the `timestamp` of each message, counted from the start of the log. `time:
    timestamp_sample` uses that field of every topic that has it, `time:
    sensor_accel_1.timestamp_sample` of one topic. Raises SpecError with all errors of the file.
    """
    del dialect  # lays out text
    with _LogFile(path) as file:
        # it prints lines of its own, which the process that reads does not show
        log = Log(file)
        is_cut, unknown = file.is_cut, file.unknown
    if log.stopped_at is not None:
        reason = f"its message before byte {log.stopped_at} is damaged or has no `{_TIME}`"
        is_whole = all(_TIME in data.data for data in log.data_list)
        raise SpecError((errors.unreadable_file(shown, reason, _REPAIR if is_whole else None),))
    if log.file_corruption:
        reason = "it is damaged: parts of it are no messages"
        raise SpecError((errors.unreadable_file(shown, reason, _REPAIR),))
    topics = _topics(log, shown)
    start = int(log.start_timestamp)
    units: dict[ColumnKey, StatedUnit] = {}
    times = _clock(topics, shown, wanted, start, units)

    def find(key: str) -> tuple[FloatArray, NamedArrays] | None:
        found = _place(topics, key, shown)
        if found is None:
            reason = _reason(log, key)
            return None if reason is None else (np.zeros(0), _unusable(shown, key, reason))
        topic, field = found
        try:
            # ULog defines the unit of times, and states none of other fields
            unit = "us" if field == _TIME or _is_stamp(topic, field) else ""
            return times(key, topic), _arrays(shown, key, lambda: _values(topic, field), unit)
        except PackingError as error:
            return np.zeros(0), _unusable(shown, key, str(error))

    streams = stream_columns(shown, wanted, _names(topics), find)
    warnings = (
        *_doubtful_start(topics, shown, start),
        *_warnings(log, shown, start, is_cut, unknown),
    )
    return replace(streams, time_units=units, warnings=warnings)


def _topics(log: Any, shown: str) -> list[_Topic]:
    parts: dict[tuple[str, int], list[Any]] = {}
    for data in log.data_list:
        # data that were appended to a log have topics of their own
        parts.setdefault((data.name, data.multi_id), []).append(data)
    topics: list[_Topic] = []
    for (name, instance), held in parts.items():
        types = _types(held[0])
        if any(_types(data) != types for data in held):
            reason = f"the topic `{name}` has two formats"
            raise SpecError((errors.unreadable_file(shown, reason),))
        arrays = {key: np.concatenate([data.data[key] for data in held]) for key in types}
        topics.append(_Topic(name, instance, arrays, types))
    return topics


def _types(data: Any) -> dict[str, str]:
    fields = {field.field_name: field.type_str for field in data.field_data}
    return {n: t for n, t in fields.items() if not n.rpartition(".")[2].startswith(_PADDING)}


def _named(topics: Sequence[_Topic], prefix: str) -> list[_Topic]:
    """The topics that a prefix may mean: `sensor_accel_1`, or `sensor_accel` for all instances."""
    return [topic for topic in topics if prefix in (topic.name, topic.label)]


def _prefix(topics: Sequence[_Topic], topic: _Topic) -> str:
    """The shortest prefix that means this topic alone."""
    return topic.name if len(_named(topics, topic.name)) == 1 else topic.label


def _names(topics: Sequence[_Topic]) -> list[str]:
    return [f"{_prefix(topics, topic)}.{field}" for topic in topics for field in topic.types]


def _place(topics: Sequence[_Topic], key: str, shown: str) -> tuple[_Topic, str] | None:
    """The topic and the field of a column; None if there is no such field."""
    prefix, _, field = key.partition(".")
    found = [topic for topic in _named(topics, prefix) if _has(topic, field)]
    if len(found) > 1:
        choices = ", ".join(f"`{_prefix(topics, topic)}.{field}`" for topic in found)
        repair = f"choose one of {choices}"
        raise SpecError((errors.duplicate_column(key, shown, None, repair),))
    return (found[0], field) if found else None


def _has(topic: _Topic, field: str) -> bool:
    return field in topic.types or f"{field}[0]" in topic.types


def _reason(log: Any, key: str) -> str | None:
    """Why a value of the whole log is no column; None if the log has no such value."""
    if key in log.initial_parameters:
        return "it is a parameter of the vehicle, without times"
    return "it is information about the log, without times" if key in log.msg_info_dict else None


def _unusable(shown: str, key: str, reason: str) -> NamedArrays:
    def refuse() -> NDArray[Any]:
        raise PackingError(reason)

    return _arrays(shown, key, refuse)


def _arrays(shown: str, key: str, get: Callable[[], NDArray[Any]], unit: str = "") -> NamedArrays:
    return NamedArrays(shown, (key,), lambda _: get(), unit_texts=lambda _: [(unit,)])


def _values(topic: _Topic, field: str) -> NDArray[Any]:
    if field not in topic.types:
        count = sum(name.startswith(f"{field}[") for name in topic.types)
        raise PackingError(f"it has {count} elements; choose one with `[0]`, `[1]`, …")
    if topic.types[field] == "char":
        raise PackingError("it holds text")
    return topic.arrays[field]


def _clock(
    topics: Sequence[_Topic],
    shown: str,
    wanted: WantedColumns,
    start: int,
    units: dict[ColumnKey, StatedUnit],
) -> Callable[[str, _Topic], FloatArray]:
    """A function that returns the times of a column; it adds their unit to `units`.

    Times are in seconds without `time:`, else in the unit of the named field.
    """
    column = wanted.time
    if column is None:
        return lambda key, topic: _microseconds(topic, _TIME, start) / 1e6
    places = [found for key in wanted.users if (found := _place_of(topics, key, shown))]
    fields = _fields_of_time(topics, column, [topic for topic, _ in places], shown)

    def times(key: str, topic: _Topic) -> FloatArray:
        field = fields.get(topic.label, _TIME)
        if not _is_stamp(topic, field):
            return _values(topic, field).astype(np.float64)
        units[key] = parse_unit("us")
        return _microseconds(topic, field, start)

    return times


def _place_of(topics: Sequence[_Topic], key: ColumnKey, shown: str) -> tuple[_Topic, str] | None:
    names = _names(topics) if isinstance(key, int) else ()
    name = key if isinstance(key, str) else names[key] if key < len(names) else None
    try:
        return None if name is None else _place(topics, name, shown)
    # reported with the column
    except SpecError:
        return None


def _fields_of_time(
    topics: Sequence[_Topic], column: TimeSource, used: Sequence[_Topic], shown: str
) -> dict[str, str]:
    """The field that `time:` names, by the topics that have it."""
    key, span = str(column.column), column.place
    prefix, _, field = key.partition(".")
    only = _named(topics, prefix) if field else []
    field = field if only else key
    fields = {
        topic.label: field for topic in used if field in topic.types and (not only or topic in only)
    }
    other = next((topic for topic in used if topic.label not in fields), None)
    if not fields and used:
        if other is not None and any(field in topic.types for topic in only or topics):
            raise SpecError((rows.time_of_another_group(key, shown, other.label, span),))
        missing = {key: "`time`"}
        names = _names(topics)
        raise SpecError((errors.missing_columns(missing, shown, names, span, numbers=False),))
    stamped = [topic for topic in used if topic.label in fields]
    # numbers may begin anywhere: they cannot be compared with times of other topics
    if not all(_is_stamp(topic, field) for topic in stamped) and len({t.label for t in used}) > 1:
        other = next(topic for topic in used if topic is not stamped[0])
        raise SpecError((rows.time_of_another_group(key, shown, other.label, span),))
    return fields


def _is_stamp(topic: _Topic, field: str) -> bool:
    """True for `timestamp`, `timestamp_sample` and others that count microseconds from boot."""
    return field.rpartition(".")[2].startswith(_TIME) and topic.types.get(field) == _STAMP


def _microseconds(topic: _Topic, field: str, start: int) -> FloatArray:
    if topic.types.get(field) != _STAMP:
        raise PackingError(f"its messages have no field `{field}` of type `{_STAMP}`")
    if start > _LATEST or (topic.arrays[field] > _LATEST).any():
        raise PackingError(f"its `{field}` is damaged")
    # subtracted as integers
    found = topic.arrays[field].astype(np.int64) - start
    if (np.abs(found) > _EXACT).any():
        raise PackingError(f"its `{field}` or the start time of the log is damaged")
    return found.astype(np.float64)


def _doubtful_start(topics: Sequence[_Topic], shown: str, start: int) -> Iterator[Diagnostic]:
    """A warning if messages cannot belong to a log that begins at this time."""
    stamps = [topic.arrays[_TIME] for topic in topics if _is_stamp(topic, _TIME)]
    if not stamps:
        return
    first = min(int(times.min()) for times in stamps) - start
    last = max(int(times.max()) for times in stamps) - start
    # some topics hold a message from before the start of the log, never all of them
    if last < 0 or last > _LONGEST or first < -_LONGEST:
        yield start_in_doubt(shown, first / 1e6, last / 1e6)


def _warnings(
    log: Any, shown: str, start: int, is_cut: bool, unknown: Mapping[str, int]
) -> tuple[Diagnostic, ...]:
    found: list[Diagnostic] = []
    if log.dropouts:
        longest = max(log.dropouts, key=lambda dropout: dropout.duration)
        at = (int(longest.timestamp) - start) / 1e6
        found.append(lost_messages(shown, [d.duration / 1e3 for d in log.dropouts], at))
    if is_cut:
        found.append(unread_part(shown, "it ends in the middle of a message"))
    if unknown:
        kinds = listed([f"`{kind}`" for kind in unknown])
        count = sum(unknown.values())
        reason = f"{count} messages are of a kind that ULog does not define: {kinds}"
        found.append(unread_part(shown, reason))
    return tuple(found)

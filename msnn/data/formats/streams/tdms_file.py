"""Reads channels of LabVIEW's TDMS files with npTDMS, and their times."""

from __future__ import annotations

import logging
import re
import struct
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from nptdms import TdmsFile
from nptdms.timestamp import TdmsTimestamp
from nptdms.types import String, TimeStamp
from numpy.typing import NDArray

from msnn.data.dataset import FloatArray
from msnn.data.formats.arrays.array_attributes import PackingError, UnitTexts, text_of, units_in
from msnn.data.formats.arrays.array_columns import NamedArrays, length_faults
from msnn.data.formats.streams.stream_columns import stream_columns
from msnn.data.formats.table import ColumnKey, ColumnTable, Streams, TimeSource, WantedColumns
from msnn.data.formats.text.csv_header import Dialect
from msnn.data.formats.written_units import StatedUnit, column_and_unit, stated_unit
from msnn.errors.data import files as errors
from msnn.errors.data import rows
from msnn.errors.data.cells import unit_of_moments
from msnn.errors.data.files import unread_part
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.expressions.moments import FARTHEST, Moment
from spec_schema.units.parser import parse_unit
from spec_schema.units.unit import Unit
from spec_schema.yaml_tree.writer import scalar_text

_UNITS = ("unit_string", "NI_UnitDescription")
"""Properties of LabVIEW with the unit of a channel."""
_START, _STEP, _OFFSET, _ABSCISSA = (
    *("wf_start_time", "wf_increment", "wf_start_offset"),
    "wf_xunit_string",
)
"""Properties of a waveform: date of its first sample, seconds between samples, seconds from the
date to the first sample, and the unit of the last two.
"""
_TICKS = 1 << 64
"""Ticks of a date per second."""
_UNTIL_1970 = 2_082_844_800
"""Seconds from 1904, where TDMS counts from, to 1970."""
_SECOND = parse_unit("s")
_CUT = ("Last segment of file has less data", "Last segment metadata is incomplete")
_PART_OF_CHUNK = "is not a multiple of the chunk size"
_OF_SCALES = ("NI_Scale", "NI_Number_Of_Scales")
"""Beginnings of the names of properties that scale values."""
_SCALE = re.compile(r"(NI_Scale\[\d+\])_Scale_Type")
_TEXTS = "Error decoding string"
"""Beginnings of npTDMS's warnings; with a text that is not UTF-8 nothing else is wrong."""
_UNSCALED = "Unsupported scale type"
_LINEAR = ("Linear_Slope", 1.0), ("Linear_Y_Intercept", 0.0)
"""Properties of a linear scale, and values with which it changes nothing."""


class _Messages(logging.Handler):
    """Collects the warnings of npTDMS, which reads on after them."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.texts: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.texts.append(record.getMessage())

    def __enter__(self) -> _Messages:
        logging.getLogger("nptdms").addHandler(self)
        return self

    def __exit__(self, *error: object) -> None:
        logging.getLogger("nptdms").removeHandler(self)


class _File(TdmsFile):
    """A file that notes waveforms whose times change in a later segment."""

    def _read_file(self, tdms_reader: Any, read_metadata_only: bool, keep_open: bool) -> None:
        self.restarted: set[str] = set()
        update = tdms_reader._update_object_properties

        # npTDMS keeps the last value of each property
        def watched(properties: Any) -> None:
            for path, pairs in (properties or {}).items():
                known = tdms_reader.object_metadata[path].properties
                if any(
                    k in (_START, _STEP, _OFFSET) and _differ(known.get(k), v) for k, v in pairs
                ):
                    self.restarted.add(path)
            update(properties)

        tdms_reader._update_object_properties = watched
        super()._read_file(tdms_reader, read_metadata_only, keep_open)

    @property
    def end(self) -> int:
        """The position behind the last segment; 0 without segments."""
        reader: Any = self._reader
        segments = reader._segments
        return segments[-1].next_segment_pos if segments else 0


def _differ(known: Any, value: Any) -> bool:
    return known is not None and bool(_ticks(known) or known) and known != value


def _ticks(value: Any) -> int:
    """Ticks since 1904; 0 for a date that was never set, and for other values."""
    if not isinstance(value, TdmsTimestamp):
        return 0
    return int(value.seconds) * _TICKS + int(value.second_fractions)


@dataclass(frozen=True, slots=True)
class _Clock:
    """The times of a channel in seconds from `first`, in ticks; None if it has no date."""

    seconds: FloatArray
    first: int | None = None


def read(path: Path, shown: str, wanted: WantedColumns, dialect: Dialect) -> Streams | ColumnTable:
    """The requested channels, with their scalings applied: `speed`, or `Engine/speed` with its
    group.

    Times are those of the waveform, else of the only channel of dates in the group. They count from
    the earliest start in the file. `time:` names another channel of the group. Without any times
    the channels are columns of one table. Raises SpecError with all errors of the file.
    """
    del dialect  # lays out text
    # an index file that lies beside it is not read: it may be of another recording
    with path.open("rb") as handle, _Messages() as messages:
        try:
            file = _File(handle, raw_timestamps=True, read_metadata_only=True, keep_open=True)
        # npTDMS does not check what it unpacks, nor the numbers of types
        except (KeyError, struct.error) as error:
            what = "its description of channels ends early"
            if isinstance(error, KeyError):
                what = "a type of data is unknown"
            fault = errors.unreadable_file(shown, f"it is damaged: {what}")
            raise SpecError((fault,)) from error
        is_cut = _is_cut(file.end, path.stat().st_size, messages.texts, shown)
        found = _Channels(file, shown, wanted, messages, is_cut).read()
    ends = unread_part(shown, "it ends in the middle of a segment")
    return replace(found, warnings=(ends,)) if is_cut else found


def _is_cut(end: int, size: int, texts: Sequence[str], shown: str) -> bool:
    """True if the last segment is not complete; SpecError for what npTDMS only warns of."""
    is_cut = any(text.startswith(_CUT) for text in texts)
    expected = [*_CUT, _TEXTS] + ([_PART_OF_CHUNK] if is_cut else [])
    found = next((t for t in texts if not any(known in t for known in expected)), None)
    reason = None if found is None else f"it is damaged (npTDMS: {found})"
    if reason is None and end == 0:
        reason = "it has no complete segment"
    if reason is not None:
        raise SpecError((errors.unreadable_file(shown, reason),))
    return is_cut or end != size


class _Channels:
    """The channels of a file, and the clock of each."""

    def __init__(
        self, file: _File, shown: str, wanted: WantedColumns, messages: _Messages, is_cut: bool
    ) -> None:
        self._file = file
        self._shown = shown
        self._wanted = wanted
        self._messages = messages
        self._is_cut = is_cut
        self._all = [channel for group in file.groups() for channel in group.channels()]
        self._count = Counter(channel.name for channel in self._all)
        self._names = [self._label(channel) for channel in self._all]
        self._dates_of: dict[str, list[Any]] = {}
        for channel in self._all:
            if channel.data_type is TimeStamp:
                self._dates_of.setdefault(channel.group_name, []).append(channel)
        self._values: dict[str, NDArray[Any] | PackingError] = {}
        self._time_units: dict[ColumnKey, StatedUnit] = {}

    def read(self) -> Streams | ColumnTable:
        column = self._wanted.time
        sources = [] if column is None else self._time_channels(column)
        clocks = self._clocks_of_wanted(sources)
        used = [clock for clock in clocks.values() if isinstance(clock, _Clock)]
        zero = self._zero(sources) if any(clock.first is not None for clock in used) else None

        def find(key: str) -> tuple[FloatArray, NamedArrays] | None:
            channel = self._channel(key)
            if channel is None:
                return None
            clock = clocks[channel.path]
            values = self._arrays(key, channel)
            if clock is None and used:
                repair = "name a channel of times in its group with `time:`"
                clock = PackingError(f"it has no times, and other columns have: {repair}")
            if isinstance(clock, _Clock) and clock.first is None and zero is not None:
                clock = PackingError("its times have no date, and those of other columns have")
            if isinstance(clock, PackingError):
                return np.zeros(0), replace(values, get=_raising(clock))
            if clock is None:
                return np.arange(len(channel), dtype=np.float64), values
            shift = 0.0 if zero is None or clock.first is None else (clock.first - zero) / _TICKS
            return clock.seconds + shift, values

        streams = stream_columns(self._shown, self._wanted, self._names, find)
        if streams.columns and not used:
            return self._table(streams)
        begins = None if zero is None else _moment(zero)
        return replace(streams, begins=begins, time_units=self._time_units)

    def _table(self, streams: Streams) -> ColumnTable:
        columns = {key: values for key, (_, values) in streams.columns.items()}
        if self._is_cut:
            count = min(map(len, columns.values()))
            columns = {key: values[:count] for key, values in columns.items()}
        if faults := length_faults(self._shown, columns):
            raise SpecError(faults)
        return ColumnTable(columns=columns, units=streams.units, packed=streams.packed)

    def _clocks_of_wanted(self, sources: Sequence[Any]) -> dict[str, _Clock | PackingError | None]:
        clocks: dict[str, _Clock | PackingError | None] = {}
        for key in self._wanted.users:
            name = self._names[key] if isinstance(key, int) and key < len(self._names) else key
            try:
                channel = self._channel(name) if isinstance(name, str) else None
            # reported with the column
            except SpecError:
                continue
            if channel is None:
                continue
            try:
                clocks[channel.path] = self._clock(channel, sources, key)
            except PackingError as error:
                clocks[channel.path] = error
        return clocks

    def _clock(self, channel: Any, sources: Sequence[Any], key: ColumnKey) -> _Clock | None:
        """The times of a channel; None if the file has none."""
        column = self._wanted.time
        if column is None:
            return self._own_clock(channel)
        source = next((s for s in sources if s.group_name == channel.group_name), None)
        if source is None:
            name, place = str(column.column), column.place
            other = rows.time_of_another_group(
                name, self._shown, channel.name, place, keeps_time=self._all_have_times()
            )
            raise SpecError((other,))
        if not self._fits(source, channel):
            count = f"it has {len(channel)} values and its time `{source.name}` has {len(source)}"
            raise PackingError(count)
        if source.data_type is TimeStamp:
            if column.unit is not None:
                text = column.unit.value.text
                raise SpecError((unit_of_moments(source.name, text, column.unit.span),))
            return self._dates(source, len(channel))
        return self._numbers(source, key, len(channel))

    def _own_clock(self, channel: Any) -> _Clock | None:
        """The times of a channel without `time:`: of its waveform, else the dates of its group."""
        clock = self._waveform(channel)
        dates = self._dates_of.get(channel.group_name, ())
        stamps = [found for found in dates if self._fits(found, channel)]
        if clock is not None or not stamps:
            return clock
        if len(dates) > 1:
            names = rows.listed([f"`{found.name}`" for found in dates])
            repair = f"name its time, `time: {scalar_text(stamps[0].name, in_flow=True)}`"
            raise PackingError(f"its group has several channels of dates, {names}: {repair}")
        return self._dates(stamps[0], len(channel))

    def _all_have_times(self) -> bool:
        """True if each channel that is read has times without `time:`."""
        keys = [self._names[k] if isinstance(k, int) else k for k in self._wanted.users]
        channels = [channel for key in keys for channel in self._places(key)]
        try:
            return all(self._own_clock(channel) is not None for channel in channels)
        except PackingError:
            return False

    def _fits(self, times: Any, channel: Any) -> bool:
        """True if a channel has a time for each value; a file that is cut off may have more."""
        return len(times) == len(channel) or (self._is_cut and len(times) > len(channel))

    def _waveform(self, channel: Any) -> _Clock | None:
        properties = channel.properties
        step, offset = properties.get(_STEP), properties.get(_OFFSET, 0.0)
        if not step:
            return None
        if channel.path in self._file.restarted:
            keys = f"`{_START}`, `{_STEP}` or `{_OFFSET}`"
            raise PackingError(f"its {keys} changes: several recordings follow each other")
        if not (_is_finite(step) and _is_finite(offset) and step > 0):
            raise PackingError(f"its `{_STEP}` is {step} and its `{_OFFSET}` {offset}")
        text = str(properties.get(_ABSCISSA, ""))
        unit = stated_unit(text) or _SECOND
        if not (isinstance(unit, Unit) and unit.same_dimension(_SECOND)):
            raise PackingError(f"its values are samples over `{text}`, not over time")
        start = _ticks(properties.get(_START)) or None
        if start is not None and _moment(start) is None:
            raise PackingError(f"its `{_START}` is no date between 1823 and 2116")
        scale = float(unit.line_to(_SECOND).factor)
        seconds = scale * (offset + step * np.arange(len(channel)))
        return _Clock(seconds, start)

    def _dates(self, channel: Any, count: int) -> _Clock:
        stamps = channel[:count]
        if not len(stamps):
            return _Clock(np.zeros(0))
        first = _ticks(stamps[0])
        far = np.abs(stamps.seconds.astype(np.float64) - _UNTIL_1970) >= FARTHEST / 1e9
        if far.any():
            reason = f"row {int(np.argmax(far))} of its time `{channel.name}` is no date"
            raise PackingError(f"{reason} between 1823 and 2116")
        # whole seconds are subtracted as integers
        whole = (stamps.seconds - stamps.seconds[0]).astype(np.float64)
        part = stamps.second_fractions.astype(np.float64) / _TICKS
        return _Clock(whole + (part - part[0]), first)

    def _numbers(self, source: Any, key: ColumnKey, count: int) -> _Clock:
        name = source.name
        arrays = self._arrays(name, source)
        # a header such as `t [ms]` has the unit in its name
        table = arrays.table(WantedColumns({name: "`time`"}, moments=frozenset({name})))
        if name in table.units:
            self._time_units[key] = table.units[name]
        return _Clock(table.columns[name][:count])

    def _zero(self, sources: Sequence[Any]) -> int | None:
        """The earliest start in the file, whichever channels are requested."""
        stamps = [source for source in sources if source.data_type is TimeStamp]
        found: list[int] = []
        if not sources:
            found = [_ticks(channel.properties.get(_START)) for channel in self._all]
            stamps = [dates[0] for dates in self._dates_of.values() if len(dates) == 1]
        found += [_ticks(source[0]) for source in stamps if len(source)]
        return min((first for first in found if first and _moment(first) is not None), default=None)

    def _time_channels(self, column: TimeSource) -> list[Any]:
        """The channels that `time:` names, one per group."""
        key = column.column
        name = key if isinstance(key, str) else self._names[key] if key < len(self._names) else ""
        found = self._places(name)
        if not found:
            missing, place = {str(key): "`time`"}, column.place
            known = self._names
            fault = errors.missing_columns(missing, self._shown, known, place, numbers=False)
            raise SpecError((fault,))
        return found

    def _label(self, channel: Any) -> str:
        """The name of a channel, with its group if another channel has the same name."""
        name, group = str(channel.name), str(channel.group_name)
        return name if self._count[name] == 1 else f"{group}/{name}"

    def _places(self, key: str) -> list[Any]:
        """The channels that a name may mean."""
        for name_of in (_own, _with_group, _path, _before_unit, _before_unit_in_group):
            found = [channel for channel in self._all if name_of(channel) == key]
            if found:
                return found
        return []

    def _channel(self, key: str) -> Any:
        found = self._places(key)
        if len(found) > 1:
            is_clear = len({_with_group(channel) for channel in found}) == len(found)
            names = [_with_group(channel) if is_clear else channel.path for channel in found]
            repair = "choose one of " + ", ".join(f"`{name}`" for name in names)
            raise SpecError((errors.duplicate_column(key, self._shown, None, repair),))
        return found[0] if found else None

    def _arrays(self, key: str, channel: Any) -> NamedArrays:
        # a name with a unit, as `speed [km/h]`, states it
        name = key if key != column_and_unit(channel.name)[0] else str(channel.name)
        if key == _before_unit_in_group(channel):
            name = _with_group(channel)
        return NamedArrays(
            self._shown,
            (name,),
            lambda _: self._read(channel),
            unit_texts=lambda _: _unit_texts(channel),
            other_names=self._names,
            other_units=self._units,
            applied=_scaling(channel),
        )

    def _units(self) -> list[str]:
        texts = (texts for channel in self._all for texts in _unit_texts(channel))
        return [text for found in texts for text in found if text]

    def _read(self, channel: Any) -> NDArray[Any]:
        """The scaled values; raises PackingError with the reason if they are no numbers."""
        if channel.path not in self._values:
            try:
                self._values[channel.path] = self._scaled(channel)
            except PackingError as error:
                self._values[channel.path] = error
        found = self._values[channel.path]
        if isinstance(found, PackingError):
            raise found
        return found

    def _scaled(self, channel: Any) -> NDArray[Any]:
        if channel.data_type is String:
            raise PackingError("it holds text")
        if channel.data_type is TimeStamp:
            raise PackingError("it holds dates, not numbers")
        if not len(channel):
            if self._is_cut:
                raise PackingError("the file ends before its first value")
            return np.zeros(0)
        before = len(self._messages.texts)
        try:
            values = channel[:]
        except MemoryError:
            raise
        # npTDMS does not check the properties that it reads, and raises a plain Exception too
        except Exception as error:
            what = "its values are damaged"
            if any(str(key).startswith(_OF_SCALES) for key in channel.properties):
                what = "its scaling (properties `NI_Scale…`) is incomplete or damaged"
            raise PackingError(f"{what} (npTDMS: {_reason(error)})") from error
        # npTDMS gives unscaled values then
        for text in self._messages.texts[before:]:
            if text.startswith(_UNSCALED):
                kind = text.rpartition(": ")[2]
                raise PackingError(
                    f"npTDMS does not know the scaling of LabVIEW that it has: {kind}"
                )
        if len(values) != len(channel):
            raise PackingError(f"the file has {len(values)} of its {len(channel)} values")
        return np.asarray(values)


def _raising(error: PackingError) -> Callable[[str], NDArray[Any]]:
    def get(name: str) -> NDArray[Any]:
        raise error

    return get


def _own(channel: Any) -> str:
    return channel.name


def _path(channel: Any) -> str:
    return channel.path


def _with_group(channel: Any) -> str:
    return f"{channel.group_name}/{channel.name}"


def _before_unit(channel: Any) -> str:
    return column_and_unit(channel.name)[0]


def _before_unit_in_group(channel: Any) -> str:
    return f"{channel.group_name}/{_before_unit(channel)}"


def _unit_texts(channel: Any) -> UnitTexts:
    properties = channel.properties
    stated = [(text_of(properties[key]),) for key in _UNITS if properties.get(key)]
    return [*stated, *units_in(properties)]


def _scales(channel: Any) -> list[str]:
    """The kinds of LabVIEW's scales that its values, its group or its file have."""
    places = (channel.properties, channel._group_properties, channel._file_properties)
    held = next((p for p in places if any(_SCALE.fullmatch(str(key)) for key in p)), {})
    if held.get("NI_Scaling_Status") == "scaled":
        return []
    found: list[str] = []
    for key, kind in held.items():
        if (scale := _SCALE.fullmatch(str(key))) is None or kind == "AdvancedAPI":
            continue
        values = [(name, held.get(f"{scale[1]}_{name}"), same) for name, same in _LINEAR]
        if kind == "Linear" and all(value == same for _, value, same in values):
            continue
        shown = ", ".join(f"{name} {value}" for name, value, _ in values if value is not None)
        found.append(f"{kind} ({shown})" if shown else str(kind))
    return found


def _scaling(channel: Any) -> str:
    """The scaling of LabVIEW that npTDMS applies to a channel, for messages; empty for none."""
    found = _scales(channel)
    return f"scaling of LabVIEW, {' and '.join(found)}" if found else ""


def _reason(error: Exception) -> str:
    text = str(error)
    return f"{type(error).__name__} {text}" if isinstance(error, KeyError) else text


def _is_finite(value: Any) -> bool:
    return isinstance(value, int | float) and bool(np.isfinite(value))


def _moment(ticks: int) -> Moment | None:
    """The date of a time in ticks, in UTC; None if it is too far away."""
    nanoseconds = (ticks * 10**9 >> 64) - _UNTIL_1970 * 10**9
    return Moment(nanoseconds, has_zone=True) if abs(nanoseconds) < FARTHEST else None

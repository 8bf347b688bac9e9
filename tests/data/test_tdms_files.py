"""Channels of TDMS files: their names, times, units, scalings, and files that are damaged."""

from __future__ import annotations

import random
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nptdms import ChannelObject, TdmsFile, TdmsWriter
from nptdms.timestamp import TdmsTimestamp

from msnn.data.dataset import Dataset
from msnn.data.formats.table import ColumnTable, Streams, TimeSource, WantedColumns
from msnn.data.formats.table_of_formats import format_of
from msnn.data.formats.text.csv_header import Dialect
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError
from spec_schema.diagnostics.source import Span
from spec_schema.expressions.moments import Moment
from tests.data.specs import load

TIME = 0.2 * np.arange(12)
UNIX = 1_700_000_000
START = TdmsTimestamp(UNIX + 2_082_844_800, 1 << 62)
"""2023-11-14 22:13:20.25 UTC."""
PLACE = Span(file="plant.msnn.yaml", line=3, column=7, end_line=3, end_column=9)
LINEAR = {
    "NI_Scaling_Status": "unscaled",
    "NI_Number_Of_Scales": 1,
    "NI_Scale[0]_Scale_Type": "Linear",
    "NI_Scale[0]_Linear_Slope": 0.5,
    "NI_Scale[0]_Linear_Y_Intercept": -3.0,
}


def waveform(
    name: str, values: Any, step: Any = 0.2, group: str = "Run", **more: Any
) -> ChannelObject:
    return ChannelObject(group, name, np.asarray(values), {"wf_increment": step, **more})


def later(seconds: int, parts: int = 1 << 62) -> TdmsTimestamp:
    return TdmsTimestamp(START.seconds + seconds, parts)


def write(path: Path, *segments: Sequence[ChannelObject]) -> None:
    with TdmsWriter(path) as writer:
        for segment in segments:
            writer.write_segment(list(segment))


def columns(path: Path, *keys: str | int, time: str | None = None) -> Streams | ColumnTable:
    source = None if time is None else TimeSource(time, PLACE)
    wanted = WantedColumns({key: f"`{key}`" for key in keys}, frozenset(keys), time=source)
    return format_of(path).reader(path, path.name, wanted, Dialect())


def streams(path: Path, *keys: str | int, time: str | None = None) -> Streams:
    found = columns(path, *keys, time=time)
    assert isinstance(found, Streams)
    return found


def faults(path: Path, *keys: str | int, time: str | None = None) -> tuple[Diagnostic, ...]:
    with pytest.raises(SpecError) as caught:
        columns(path, *keys, time=time)
    return caught.value.diagnostics


def times(data: Dataset) -> np.ndarray:
    (piece,) = data.records[0].pieces
    assert piece.time is not None
    return np.asarray(piece.time)


def test_a_waveform_has_its_own_times(tmp_path: Path) -> None:
    fast = waveform("x", np.sin(TIME), wf_start_time=START, wf_start_offset=0.0)
    slow = waveform("F", np.arange(6), 0.4, wf_start_time=later(1), wf_start_offset=0.125)
    write(tmp_path / "a.tdms", [fast, slow])
    found = streams(tmp_path / "a.tdms", "x", "F")
    # the start of the file, which is that of `x`
    assert found.begins == Moment(UNIX * 10**9 + 250_000_000, has_zone=True)
    np.testing.assert_array_equal(found.columns["x"], (TIME, np.sin(TIME)))
    np.testing.assert_allclose(found.columns["F"][0], 1.125 + 0.4 * np.arange(6), rtol=1e-15)
    # whichever channels are read
    alone = streams(tmp_path / "a.tdms", "F")
    np.testing.assert_array_equal(alone.columns["F"], found.columns["F"])
    whole = TdmsFile.read(tmp_path / "a.tdms")["Run"]
    for name, (time, values) in found.columns.items():
        channel = whole[str(name)]
        np.testing.assert_array_equal(values, channel.data)
        dates = channel.time_track(absolute_time=True)
        seconds = (dates - np.datetime64(UNIX, "s")) / np.timedelta64(1, "ns") / 1e9 - 0.25
        np.testing.assert_allclose(time, seconds, atol=2e-9)


def test_channels_of_several_rates_are_brought_to_the_sample_time(tmp_path: Path) -> None:
    fine = 0.05 * np.arange(45)
    write(tmp_path / "a.tdms", [waveform("x", TIME), waveform("F", -fine, 0.05)])
    section = "source: {train: a.tdms}\n"
    with pytest.raises(SpecError, match="E0842"):
        load(tmp_path, section)
    data = load(tmp_path, f"{section}resample: linear\n")
    np.testing.assert_allclose(times(data), TIME, atol=1e-12)
    np.testing.assert_allclose(data.series["F"], -TIME, atol=1e-12)


def test_files_with_dates_are_joined_by_them(tmp_path: Path) -> None:
    """The first file has 2.4 s; the second follows it, or begins 2.5625 s after its start."""
    following, late = later(2, int(0.65 * (1 << 64))), later(2, 13 << 60)
    episodes: list[list[list[int]]] = []
    for second in (following, late):
        for name, start in (("a", START), ("b", second), ("c", later(9))):
            pair = [waveform(key, TIME, wf_start_time=start) for key in ("x", "F")]
            write(tmp_path / f"{name}.tdms", pair)
        data = load(tmp_path, "source: {train: ['*.tdms']}\njoin: true\n")
        episodes.append(data.episodes("train").tolist())
    assert episodes == [[[0, 24], [24, 36]], [[0, 12], [12, 24], [24, 36]]]


@pytest.mark.parametrize("unit", ["s", "", "Seconds", "ms"])
def test_the_step_of_a_waveform_has_a_unit(tmp_path: Path, unit: str) -> None:
    step = 200.0 if unit == "ms" else 0.2
    write(tmp_path / "a.tdms", [waveform("x", TIME, step, wf_xunit_string=unit)])
    found = streams(tmp_path / "a.tdms", "x")
    np.testing.assert_allclose(found.columns["x"][0], TIME, rtol=1e-15)
    assert found.begins is None


@pytest.mark.parametrize(
    ("properties", "reason"),
    [
        ({"wf_xunit_string": "Hz"}, "its values are samples over `Hz`, not over time"),
        ({"wf_increment": -0.2}, "its `wf_increment` is -0.2"),
        ({"wf_increment": float("nan")}, "its `wf_increment` is nan"),
        ({"wf_start_offset": float("inf")}, "its `wf_start_offset` inf"),
        ({"wf_increment": "fast"}, "its `wf_increment` is fast"),
        ({"wf_start_time": TdmsTimestamp(1 << 62, 0)}, "is no date between 1823 and 2116"),
    ],
)
def test_a_waveform_without_usable_times_is_refused(
    tmp_path: Path, properties: dict[str, Any], reason: str
) -> None:
    write(tmp_path / "a.tdms", [waveform("x", TIME, **properties)])
    (fault,) = faults(tmp_path / "a.tdms", "x")
    assert (fault.code, reason in fault.message) == ("E0840", True)


def test_a_recording_that_begins_anew_in_the_same_file_is_refused(tmp_path: Path) -> None:
    """npTDMS gives the last start to all values."""
    first, second = (waveform("x", TIME, wf_start_time=later(60 * k)) for k in range(2))
    write(tmp_path / "a.tdms", [first], [second])
    (fault,) = faults(tmp_path / "a.tdms", "x")
    assert "several recordings follow each other" in fault.message
    write(tmp_path / "b.tdms", [first], [first])
    (time, values) = streams(tmp_path / "b.tdms", "x").columns["x"]
    np.testing.assert_allclose(time, 0.2 * np.arange(24), rtol=1e-15)
    np.testing.assert_array_equal(values, [*TIME, *TIME])


def test_a_channel_is_named_alone_or_with_its_group(tmp_path: Path) -> None:
    write(
        tmp_path / "a.tdms",
        [waveform("x", TIME), waveform("F [kN]", -TIME), waveform("x", 2 * TIME, group="B/C")],
    )
    found = streams(tmp_path / "a.tdms", "Run/x", "B/C/x", "/'Run'/'x'", "F", "Run/F", "F [kN]", 2)
    values = {key: values[1] / 0.2 for key, (_, values) in found.columns.items()}
    assert values == pytest.approx(
        {"Run/x": 1, "B/C/x": 2, "/'Run'/'x'": 1, "F": -1, "Run/F": -1, "F [kN]": -1, 2: -1}
    )
    assert {str(found.units[key]) for key in ("F", "Run/F", "F [kN]", 2)} == {"kN"}
    (fault,) = faults(tmp_path / "a.tdms", "x")
    assert (fault.code, fault.help) == ("E0814", "choose one of `B/C/x`, `Run/x`")
    (fault,) = faults(tmp_path / "a.tdms", "y")
    assert (fault.code, fault.notes) == ("E0804", ("columns: B/C/x, Run/x, F [kN]",))


def test_names_with_slashes_are_told_apart_by_paths(tmp_path: Path) -> None:
    write(
        tmp_path / "a.tdms",
        [waveform("b/c", TIME, group="a"), waveform("c", -TIME, group="a/b")],
    )
    (fault,) = faults(tmp_path / "a.tdms", "a/b/c")
    assert fault.help == "choose one of `/'a'/'b/c'`, `/'a/b'/'c'`"
    found = streams(tmp_path / "a.tdms", "/'a/b'/'c'")
    assert found.columns["/'a/b'/'c'"][1][1] == -0.2


@pytest.mark.parametrize(
    ("properties", "unit"),
    [
        ({"unit_string": "km/h"}, "km/h"),
        ({"unit_string": "Volts"}, "V"),
        ({"unit_string": "", "NI_UnitDescription": "m/s"}, "m/s"),
        ({"unit_string": "Volts", "NI_UnitDescription": "V"}, "V"),
        ({"unit_string": "custom", "NI_UnitDescription": "m/s"}, "m/s"),
        ({"unit": "bar"}, "bar"),
        ({}, "None"),
    ],
)
def test_a_property_states_the_unit(tmp_path: Path, properties: dict[str, str], unit: str) -> None:
    write(tmp_path / "a.tdms", [waveform("x", TIME, **properties)])
    assert str(streams(tmp_path / "a.tdms", "x").units.get("x")) == unit


def test_two_units_of_a_channel_are_asked(tmp_path: Path) -> None:
    units = {"unit_string": "km", "NI_UnitDescription": "m"}
    write(tmp_path / "a.tdms", [waveform("x", TIME, **units), waveform("F", TIME)])
    with pytest.raises(SpecError, match="E0991") as caught:
        load(tmp_path, "source: {train: a.tdms}\n")
    assert "states two units of column `x`: km and m" in str(caught.value)
    data = load(tmp_path, "source: {train: a.tdms}\ncolumns: {x: {column: x, unit: km}}\n")
    np.testing.assert_allclose(data.series["x"], 1000 * TIME)


@pytest.mark.parametrize(
    ("scaling", "count", "words"),
    [
        (LINEAR, 1, "its scaling of LabVIEW, Linear (Linear_Slope 0.5, Linear_Y_Intercept -3.0)"),
        ({**LINEAR, "NI_Scaling_Status": "scaled"}, 0, ""),
        ({**LINEAR, "NI_Scale[0]_Linear_Slope": 1, "NI_Scale[0]_Linear_Y_Intercept": 0}, 0, ""),
        ({"NI_Number_Of_Scales": 1, "NI_Scale[0]_Scale_Type": "AdvancedAPI"}, 0, ""),
    ],
)
@pytest.mark.parametrize("step", [0.2, 0.0])
def test_a_scale_of_the_spec_beside_that_of_labview_is_a_warning(
    tmp_path: Path, scaling: dict[str, Any], count: int, words: str, step: float
) -> None:
    """Of waveforms, and of rows without times."""
    raw = np.arange(12, dtype=np.int16)
    write(tmp_path / "a.tdms", [waveform("x", raw, step, **scaling), waveform("F", raw, step)])
    section = "source: {train: a.tdms}\ncolumns: {x: {column: x, scale: 10}}\n"
    found = [one for one in load(tmp_path, section).warnings if one.code == "W0835"]
    assert len(found) == count
    assert all(words in warning.message for warning in found)


def test_of_two_channels_of_dates_one_is_to_be_named(tmp_path: Path) -> None:
    dates = np.datetime64("2023-11-14T22:13:20") + (TIME * 1e6).astype("timedelta64[us]")
    late = dates + np.timedelta64(1, "s")
    channels = [ChannelObject("A", name, clock) for name, clock in (("at", dates), ("sent", late))]
    channels += [ChannelObject("A", name, sign * TIME) for name, sign in (("x", 1), ("F", -1))]
    write(tmp_path / "a.tdms", channels)
    fault, _ = faults(tmp_path / "a.tdms", "x", "F")
    assert fault.code == "E0840"
    assert "several channels of dates, `at`, `sent`: name its time, `time: at`" in fault.message
    data = load(tmp_path, "source: {train: a.tdms}\ntime: at\n")
    np.testing.assert_allclose(times(data), TIME, atol=1e-12)


def test_dates_are_picked_with_their_zone(tmp_path: Path) -> None:
    write(tmp_path / "a.tdms", [waveform(k, TIME, wf_start_time=START) for k in ("x", "F")])
    section = "source: {train: a.tdms}\nfrom: 2023-11-14 22:13:21.25"
    with pytest.raises(SpecError, match="E0979"):
        load(tmp_path, f"{section}\n")
    np.testing.assert_allclose(load(tmp_path, f"{section}Z\n").series["x"], TIME[5:])


def test_time_is_left_out_only_where_the_file_keeps_times(tmp_path: Path) -> None:
    for step in (0.0, 0.2):
        plain = ChannelObject("A", "t", TIME)
        pair = [waveform("x", TIME, step, group="A"), waveform("F", -TIME, step, group="B")]
        write(tmp_path / "a.tdms", [plain, *pair])
        (fault,) = faults(tmp_path / "a.tdms", "x", "F", time="t")
        assert fault.code == "E0875"
        assert ("or leave `time:` out" in str(fault.help)) == bool(step)
    load(tmp_path, "source: {train: a.tdms}\n")


def test_a_channel_of_the_group_is_the_time(tmp_path: Path) -> None:
    """A channel of numbers counts with its unit, in the group of each column."""
    tables = [("A", 1.0, "ms", 1000 * TIME), ("B", -1.0, "s", TIME)]
    channels = [
        channel
        for group, sign, unit, clock in tables
        for channel in (
            ChannelObject(group, "t", clock, {"unit_string": unit}),
            ChannelObject(group, "xF"[group == "B"], sign * TIME),
        )
    ]
    write(tmp_path / "a.tdms", channels)
    data = load(tmp_path, "source: {train: a.tdms}\ntime: t\nresample: linear\n")
    np.testing.assert_allclose(times(data), TIME, atol=1e-12)
    np.testing.assert_allclose(data.series["F"], -TIME, atol=1e-12)
    (fault,) = faults(tmp_path / "a.tdms", "x", "F", time="A/t")
    assert (fault.code, "times of `F`" in fault.message) == ("E0875", True)
    (fault,) = faults(tmp_path / "a.tdms", "x", time="clock")
    assert (fault.code, fault.span) == ("E0804", PLACE)


@pytest.mark.parametrize("time", [None, "at"])
def test_a_channel_of_dates_is_the_time_of_its_group(tmp_path: Path, time: str | None) -> None:
    dates = np.datetime64("2023-11-14T22:13:20.5") + (TIME * 1e6).astype("timedelta64[us]")
    write(
        tmp_path / "a.tdms",
        [
            ChannelObject("A", "at", dates + np.timedelta64(3, "s")),
            ChannelObject("A", "x", TIME),
            ChannelObject("B", "at", dates),
            ChannelObject("B", "F", -TIME),
        ],
    )
    found = streams(tmp_path / "a.tdms", "x", "F", time=time)
    # fractions of 2⁻⁶⁴ s are rounded down to nanoseconds
    assert found.begins is not None
    assert abs(found.begins.nanoseconds - UNIX * 10**9 - 500_000_000) <= 1
    np.testing.assert_allclose(found.columns["F"][0], TIME, atol=1e-12)
    np.testing.assert_allclose(found.columns["x"][0], 3 + TIME, atol=1e-12)
    with pytest.raises(SpecError, match="E0998"):
        load(tmp_path, "source: {train: a.tdms}\ntime: {column: at, unit: ms}\n")
    (fault,) = faults(tmp_path / "a.tdms", "A/at")
    assert "it holds dates, not numbers" in fault.message


def test_channels_without_times_are_a_table(tmp_path: Path) -> None:
    write(tmp_path / "a.tdms", [ChannelObject("A", "x", TIME), ChannelObject("A", "F", -TIME)])
    data = load(tmp_path, "source: {train: a.tdms}\n")
    np.testing.assert_array_equal(data.series["F"], -TIME)
    assert data.episodes("train").tolist() == [[0, 12]]
    with pytest.raises(SpecError, match="E0843"):
        load(tmp_path, "source: {train: a.tdms}\nresample: linear\n")
    for key in ("resample: none", "join: true"):
        with pytest.raises(SpecError, match="E0876"):
            load(tmp_path, f"source: {{train: a.tdms}}\n{key}\n")
    write(tmp_path / "b.tdms", [ChannelObject("A", "x", TIME), ChannelObject("A", "F", TIME[1:])])
    with pytest.raises(SpecError, match="E0841"):
        load(tmp_path, "source: {train: b.tdms}\n")


def test_times_that_cannot_be_compared_are_refused(tmp_path: Path) -> None:
    write(
        tmp_path / "a.tdms",
        [
            waveform("dated", TIME, wf_start_time=START),
            waveform("undated", TIME, wf_start_time=TdmsTimestamp(0, 0)),
            ChannelObject("Run", "plain", TIME),
        ],
    )
    (fault,) = faults(tmp_path / "a.tdms", "dated", "undated")
    assert "`undated`" in fault.message
    assert "its times have no date, and those of other columns have" in fault.message
    (fault,) = faults(tmp_path / "a.tdms", "undated", "plain")
    assert "it has no times, and other columns have" in fault.message


@pytest.mark.parametrize(
    ("scaling", "expected"),
    [
        (LINEAR, lambda raw: 0.5 * raw - 3),
        ({**LINEAR, "NI_Scaling_Status": "scaled"}, lambda raw: raw),
        (
            {
                "NI_Scale[0]_Scale_Type": "Polynomial",
                **{f"NI_Scale[0]_Polynomial_Coefficients[{k}]": 1.0 / (k + 1) for k in range(4)},
            },
            lambda raw: 1 + raw / 2 + raw**2 / 3 + raw**3 / 4,
        ),
        (
            {
                "NI_Scale[0]_Scale_Type": "Table",
                "NI_Scale[0]_Table_Pre_Scaled_Values_Size": 2,
                "NI_Scale[0]_Table_Scaled_Values_Size": 2,
                **{f"NI_Scale[0]_Table_Pre_Scaled_Values[{k}]": 10.0 * k for k in range(2)},
                **{f"NI_Scale[0]_Table_Scaled_Values[{k}]": 25.0 * k for k in range(2)},
            },
            lambda raw: 2.5 * raw,
        ),
    ],
    ids=["linear", "scaled before", "polynomial", "table"],
)
def test_raw_values_are_scaled(tmp_path: Path, scaling: dict[str, Any], expected: Any) -> None:
    raw = np.arange(10, dtype=np.int16)
    write(tmp_path / "a.tdms", [waveform("x", raw, **scaling)])
    _, values = streams(tmp_path / "a.tdms", "x").columns["x"]
    np.testing.assert_allclose(values, expected(raw.astype(float)), rtol=1e-15)
    np.testing.assert_array_equal(values, TdmsFile.read(tmp_path / "a.tdms")["Run"]["x"].data)


@pytest.mark.parametrize(
    ("scaling", "reason"),
    [
        (
            {"NI_Scale[0]_Scale_Type": "Cubic"},
            "does not know the scaling of LabVIEW that it has: C",
        ),
        (
            {"NI_Scale[0]_Scale_Type": "Linear"},
            "its scaling (properties `NI_Scale…`) is incomplete",
        ),
        (
            {"NI_Number_Of_Scales": 1, "NI_Scale[0]_Linear_Slope": 1.0},
            "its scaling (properties `NI_Scale…`) is incomplete or damaged (npTDMS: ",
        ),
    ],
)
def test_raw_values_that_cannot_be_scaled_are_refused(
    tmp_path: Path, scaling: dict[str, Any], reason: str
) -> None:
    """npTDMS gives the raw values, with a warning."""
    write(tmp_path / "a.tdms", [waveform("x", np.arange(10, dtype=np.int16), **scaling)])
    found = faults(tmp_path / "a.tdms", "x", "Run/x")
    assert [fault.code for fault in found] == ["E0840", "E0840"]
    assert all(reason in fault.message for fault in found)


KINDS = ["i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "f4", "f8", "?"]


@pytest.mark.parametrize("kind", KINDS)
def test_numbers_of_every_type_are_values(tmp_path: Path, kind: str) -> None:
    raw = np.array([0, 1, 100, 7], kind)
    write(tmp_path / "a.tdms", [waveform("x", raw)])
    _, values = streams(tmp_path / "a.tdms", "x").columns["x"]
    np.testing.assert_array_equal(values, raw.astype(float))


def test_text_and_complex_numbers_are_refused_by_name(tmp_path: Path) -> None:
    write(tmp_path / "a.tdms", [waveform("s", ["a", "b"]), waveform("z", [1j, 2])])
    text, numbers = faults(tmp_path / "a.tdms", "s", "z")
    assert "`s` of a.tdms cannot feed `s`: it holds text" in text.message
    assert "`z` of a.tdms cannot feed `z`: it does not hold real numbers" in numbers.message


def test_nan_is_a_missing_value(tmp_path: Path) -> None:
    force = np.where(TIME[3] == TIME, np.nan, TIME)
    write(tmp_path / "a.tdms", [waveform("x", TIME), waveform("F", force)])
    with pytest.raises(SpecError, match="E0809"):
        load(tmp_path, "source: {train: a.tdms}\n")
    data = load(tmp_path, "source: {train: a.tdms}\nnan: split\n")
    assert data.episodes("train").tolist() == [[0, 3], [4, 12]]


def test_an_index_file_of_another_recording_is_not_read(tmp_path: Path) -> None:
    write(tmp_path / "a.tdms", [waveform("x", TIME)])
    write(tmp_path / "b.tdms", [waveform("y", TIME)])
    index = bytearray((tmp_path / "b.tdms").read_bytes())
    index[:4] = b"TDSh"
    (tmp_path / "a.tdms_index").write_bytes(index)
    np.testing.assert_array_equal(streams(tmp_path / "a.tdms", "x").columns["x"][1], TIME)


def text_bytes(text: str, order: str) -> bytes:
    return struct.pack(f"{order}L", len(text)) + text.encode()


def segment(toc: int, meta: bytes, raw: bytes, order: str = "<") -> bytes:
    lead = struct.pack("<4sl", b"TDSm", toc) + struct.pack(
        f"{order}lQQ", 4713, len(meta) + len(raw), len(meta)
    )
    return lead + meta + raw


def property_bytes(name: str, value: float | str, order: str) -> bytes:
    if isinstance(value, str):
        kind, content = 0x20, text_bytes(value, order)
    elif isinstance(value, int):
        kind, content = 7, struct.pack(f"{order}L", value)
    else:
        kind, content = 10, struct.pack(f"{order}d", value)
    return text_bytes(name, order) + struct.pack(f"{order}L", kind) + content


def test_interleaved_big_endian_values_are_read(tmp_path: Path) -> None:
    """Written by hand from the specification of TDMS 2.0: npTDMS writes neither."""
    meta = struct.pack(">L", 2)
    for name, kind in (("x", 10), ("F", 2)):
        meta += text_bytes(f"/'Run'/'{name}'", ">") + struct.pack(">LLLQ", 20, kind, 1, 12)
        meta += struct.pack(">L", 1) + property_bytes("wf_increment", 0.2, ">")
    rows = b"".join(struct.pack(">dh", 0.2 * i, -i) for i in range(12))
    flags = 1 << 1 | 1 << 2 | 1 << 3 | 1 << 5 | 1 << 6
    (tmp_path / "a.tdms").write_bytes(segment(flags, meta, rows, ">"))
    data = load(tmp_path, "source: {train: a.tdms}\n")
    np.testing.assert_array_equal(data.series["x"], TIME)
    np.testing.assert_array_equal(data.series["F"], -np.arange(12))


def test_raw_values_of_daqmx_are_scaled(tmp_path: Path) -> None:
    """By hand too: 16 bits at the second of two places of a row, then a linear scale."""
    meta = struct.pack("<L", 1) + text_bytes("/'Run'/'x'", "<")
    meta += struct.pack("<LLLQL", 0x1269, 0xFFFFFFFF, 1, 12, 1)
    meta += struct.pack("<5L", 3, 0, 2, 0, 0) + struct.pack("<LL", 1, 4)
    scaling = {
        "wf_increment": 0.2,
        "NI_Number_Of_Scales": 2,
        "NI_Scaling_Status": "unscaled",
        "NI_Scale[1]_Scale_Type": "Linear",
        "NI_Scale[1]_Linear_Slope": 0.25,
        "NI_Scale[1]_Linear_Y_Intercept": 1.0,
        "NI_Scale[1]_Linear_Input_Source": 0,
    }
    meta += struct.pack("<L", len(scaling))
    meta += b"".join(property_bytes(name, value, "<") for name, value in scaling.items())
    rows = b"".join(struct.pack("<hh", 99, i) for i in range(12))
    flags = 1 << 1 | 1 << 2 | 1 << 3 | 1 << 7
    (tmp_path / "a.tdms").write_bytes(segment(flags, meta, rows))
    _, values = streams(tmp_path / "a.tdms", "x").columns["x"]
    np.testing.assert_array_equal(values, 1 + 0.25 * np.arange(12))


def test_a_file_that_is_cut_off_is_read_up_to_there(tmp_path: Path) -> None:
    channels = [waveform("x", TIME), waveform("F", -TIME)]
    write(tmp_path / "a.tdms", channels, channels)
    whole = (tmp_path / "a.tdms").read_bytes()
    length = whole.index(b"TDSm", 4)
    cases = {
        # in the values of `F`, of `x`, in the header and in the lead-in of the second segment
        len(whole) - 3: (24, 23),
        len(whole) - 100: (23, 12),
        length + 100: (12, 12),
        length + 20: (12, 12),
    }
    for size, (of_x, of_force) in cases.items():
        (tmp_path / "b.tdms").write_bytes(whole[:size])
        found = streams(tmp_path / "b.tdms", "x", "F")
        (warning,) = found.warnings
        assert warning.code == "W0838"
        x, force = (found.columns[key][1] for key in ("x", "F"))
        np.testing.assert_array_equal(x, [*TIME, *TIME][:of_x])
        np.testing.assert_array_equal(force, [*-TIME, *-TIME][:of_force])
    (tmp_path / "b.tdms").write_bytes(whole[: length // 4])
    (fault,) = faults(tmp_path / "b.tdms", "x")
    assert "it has no complete segment" in fault.message
    # LabVIEW writes the length when it closes the file
    unfinished = bytearray(whole)
    unfinished[length + 12 : length + 20] = b"\xff" * 8
    (tmp_path / "b.tdms").write_bytes(unfinished)
    found = streams(tmp_path / "b.tdms", "x", "F")
    assert [warning.code for warning in found.warnings] == ["W0838"]
    np.testing.assert_array_equal(found.columns["F"][1], [*-TIME, *-TIME])


def test_channels_without_times_end_together_in_a_file_that_is_cut_off(tmp_path: Path) -> None:
    channels = [ChannelObject("A", key, sign * TIME) for key, sign in (("x", 1), ("F", -1))]
    write(tmp_path / "a.tdms", channels, channels)
    (tmp_path / "b.tdms").write_bytes((tmp_path / "a.tdms").read_bytes()[:-17])
    found = columns(tmp_path / "b.tdms", "x", "F")
    assert isinstance(found, ColumnTable)
    assert {len(values) for values in found.columns.values()} == {21}
    assert [warning.code for warning in found.warnings] == ["W0838"]


def test_a_warning_of_a_file_is_a_warning_of_the_data(tmp_path: Path) -> None:
    channels = [waveform("x", TIME), waveform("F", -TIME)]
    write(tmp_path / "a.tdms", channels)
    (tmp_path / "a.tdms").write_bytes((tmp_path / "a.tdms").read_bytes() + b"TDSm and no more")
    data = load(tmp_path, "source: {train: a.tdms}\n")
    assert [warning.code for warning in data.warnings] == ["W0838"]


@pytest.mark.parametrize(("clock", "time"), [(TIME, "t"), (1e6 * TIME, None)])
def test_a_channel_of_times_may_be_longer_in_a_file_that_is_cut_off(
    tmp_path: Path, clock: np.ndarray, time: str | None
) -> None:
    if time is None:
        clock = np.datetime64("2023-11-14T22:13:20") + clock.astype("timedelta64[us]")
    write(tmp_path / "a.tdms", [ChannelObject("A", "t", clock), ChannelObject("A", "x", TIME)])
    (tmp_path / "b.tdms").write_bytes((tmp_path / "a.tdms").read_bytes()[:-17])
    found = streams(tmp_path / "b.tdms", "x", time=time)
    np.testing.assert_allclose(found.columns["x"], (TIME[:9], TIME[:9]), atol=1e-12)
    write(tmp_path / "b.tdms", [ChannelObject("A", "t", clock), ChannelObject("A", "x", TIME[:9])])
    if time is not None:
        (fault,) = faults(tmp_path / "b.tdms", "x", time=time)
        assert "it has 9 values and its time `t` has 12" in fault.message


@pytest.mark.parametrize(
    ("after", "at", "value", "reason"),
    [
        (b"", 8, 1, "Unrecognised version number"),
        (b"", 0, 0x41414141, "File should either start with"),
        # number of values of `x`, and their type
        (b"/'Run'/'x'", 12, 13, "is not a multiple of the chunk size"),
        (b"/'Run'/'x'", 4, 99, "it is damaged: a type of data is unknown"),
        # length of the name of a property
        (b"/'Run'/'F'", 24, 1 << 20, "its description of channels ends early"),
    ],
)
def test_damage_is_an_error_even_where_the_library_only_warns(
    tmp_path: Path, after: bytes, at: int, value: int, reason: str
) -> None:
    write(tmp_path / "a.tdms", [waveform("x", TIME), waveform("F", -TIME)])
    damaged = bytearray((tmp_path / "a.tdms").read_bytes())
    at += damaged.index(after) + len(after)
    damaged[at : at + 4] = struct.pack("<L", value)
    (tmp_path / "a.tdms").write_bytes(damaged)
    (fault,) = faults(tmp_path / "a.tdms", "x")
    assert (fault.code, reason in fault.message) == ("E0802", True)


def test_a_text_that_is_not_utf_8_leaves_values_alone(tmp_path: Path) -> None:
    write(tmp_path / "a.tdms", [waveform("x", TIME, comment="hot")])
    text = (tmp_path / "a.tdms").read_bytes().replace(b"hot", b"h\xf6t")
    (tmp_path / "a.tdms").write_bytes(text)
    np.testing.assert_array_equal(streams(tmp_path / "a.tdms", "x").columns["x"][1], TIME)


def test_no_damage_raises_anything_but_a_message(tmp_path: Path) -> None:
    """What the reader does not turn into a message, the process that runs it does."""
    write(tmp_path / "a.tdms", *[[waveform("x", TIME), waveform("F", -TIME)]] * 2)
    whole = (tmp_path / "a.tdms").read_bytes()
    wanted = WantedColumns({"x": "`x`", "F": "`F`"})
    seen: set[str] = set()
    for seed in range(12):
        generator, damaged = random.Random(seed), bytearray(whole)
        for _ in range(5):
            damaged[generator.randrange(200)] = generator.randrange(256)
        (tmp_path / "b.tdms").write_bytes(damaged)
        try:
            format_of("b.tdms").reader(tmp_path / "b.tdms", "b.tdms", wanted, Dialect())
        except SpecError as error:
            seen |= {fault.code for fault in error.diagnostics}
    assert seen <= {"E0802", "E0804", "E0840", "E0803"}
    assert "E0802" in seen

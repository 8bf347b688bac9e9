"""A unit that a file states is converted, or reported if it is not understood, in every format."""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import openpyxl
import pandas as pd
import pint
import polars as pl
import pytest
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_typestore

import msnn
from msnn.data.formats.arrays.array_attributes import unit_beside
from msnn.data.formats.table_of_formats import FORMATS, format_of
from msnn.data.reading.frames import frame_data
from spec_schema.diagnostics.diagnostic import SpecError
from tests.data.unit_files import (
    SPEC,
    TIME,
    WRITERS,
    V,
    load,
    read,
    write_hdf5,
    write_xlsx_of_formats,
)


def test_every_format_that_states_units_is_here() -> None:
    # of ROS bags the messages state them, see below; ULog files state none
    others = {"ROS bag", "ULog"}
    written = {format_of(name).name for name, _, _ in WRITERS.values()} | others
    assert written == {format.name for format in FORMATS}


@pytest.mark.parametrize("kind", WRITERS)
@pytest.mark.parametrize(
    ("stated", "unit", "first"),
    [
        ("km/h", "m/s", 10.0),
        ("U/min", "rpm", 36.0),
        ("r/min", "rev/s", 0.6),
        ("Upm", "rad/s", 36 * np.pi / 30),
        ("rev/s", "rpm", 2160.0),
        ("°C", "K", 309.15),
        ("m·s⁻¹", "km/h", 129.6),
        ("bar", "Pa", 36e5),
        ("dB", "1", 10**1.8),
        ("%", "dB", 20 * np.log10(0.36)),
    ],
)
def test_a_unit_of_the_file_converts(
    tmp_path: Path, kind: str, stated: str, unit: str, first: float
) -> None:
    data = read(tmp_path, kind, stated, unit)
    # the conversion rounds once, and so does the number written here; decibels three times
    rounding = 1e-14 if "dB" in (stated, unit) else 1e-15
    assert data.series["v"][0] == pytest.approx(first, rel=rounding)
    assert data.warnings == ()


@pytest.mark.parametrize("kind", WRITERS)
def test_a_unit_that_nobody_knows_is_reported(tmp_path: Path, kind: str) -> None:
    data = read(tmp_path, kind, "furlong/h", "m/s")
    assert data.series["v"].tolist() == V.tolist()
    (warning,) = data.warnings
    assert warning.code == "W0511"
    assert "`furlong/h`" in warning.message
    # the advice
    assert read(tmp_path, kind, "furlong/h", "m/s", ", unit: m/s").warnings == ()


@pytest.mark.parametrize("kind", ["csv", "excel", "hdf5", "parquet"])
@pytest.mark.parametrize(
    ("stated", "unit", "meant"),
    [
        # no gigaradians: degrees or gradians of a German tool
        ("GRAD", "rad", "deg"),
        ("Grad/s", "rad/s", "deg/s"),
        ("grad", "rev", "deg"),
        # no nanolitres: normal litres
        ("NL/MIN", "m^3/s", "L/min"),
        ("NL", "L", "L"),
        ("Nl/min", "m^3/s", "L/min"),
        ("NM3/H", "m^3/s", "m^3/s"),
        ("nm³/h", "m^3/s", "m^3/h"),
        ("mt", "kg", "t"),
        ("gm/s", "kg/s", "g/s"),
        ("cc", "m^3", "cm^3"),
        ("1/CC", "1/m^3", "1/cm^3"),
        ("Mm", "m", "mm"),
        ("TM", "m", "m"),
        ("DAS", "s", "s"),
        # tools that write a capital letter first
        ("Mg/L", "kg/m^3", "mg/L"),
        ("Mbar", "Pa", "mbar"),
        ("MAh", "A*s", "mAh"),
        ("Ml", "L", "mL"),
        ("Gmol", "mol", "mol"),
        # hours, calories of food, differences
        ("hs", "s", "h"),
        ("Std", "h", "h"),
        ("Cal", "J", "kcal"),
        ("dV", "V", "V"),
        ("dA", "A", "A"),
        ("gn", "m/s^2", "g0"),
        ("Ft", "m", "ft"),
    ],
)
def test_units_that_nobody_measures_in_are_not_read(
    tmp_path: Path, kind: str, stated: str, unit: str, meant: str
) -> None:
    data = read(tmp_path, kind, stated, unit)
    assert data.series["v"].tolist() == V.tolist()
    (warning,) = data.warnings
    assert warning.code == "W0511"
    assert f"unit: {meant}}}" in str(warning.help)
    # the advice
    assert read(tmp_path, kind, stated, unit, f", unit: {meant}").warnings == ()


@pytest.mark.parametrize(
    ("stated", "unit", "first"),
    [
        ("nL/min", "L/min", 36e-9),
        ("nl", "L", 36e-9),
        ("DAN", "N", 360.0),
        ("hpa", "Pa", 3600.0),
        ("GHZ", "Hz", 36e9),
        ("Grad C", "K", 309.15),
        ("GRAD CELSIUS", "K", 309.15),
        ("nm^2", "m^2", 36e-18),
        ("HPa", "Pa", 3600.0),
        ("gon", "deg", 32.4),
        ("mgon", "gon", 0.036),
        ("ccm", "L", 0.036),
        ("Sek", "s", 36.0),
        ("Liter/Stunde", "m^3/s", 1e-5),
        # characters that are a unit, and signs of other fonts
        ("℃", "K", 309.15),
        ("ºC", "K", 309.15),
        ("㎜", "m", 0.036),
        ("㎥/h", "m^3/s", 0.01),
        ("kg/㎥", "g/L", 36.0),
        ("N/㎧", "N*s/m", 36.0),
        ("kΩ", "ohm", 36000.0),
        ("㏀", "ohm", 36000.0),
        ("W/(m⋅K)", "W/m/K", 36.0),
        ("N×m", "J", 36.0),
        ("m∕s", "km/h", 129.6),
        ("ｋｍ／ｈ", "m/s", 10.0),
    ],
)
def test_units_with_seldom_prefixes_are_read_where_they_are_usual(
    tmp_path: Path, stated: str, unit: str, first: float
) -> None:
    data = read(tmp_path, "csv", stated, unit)
    assert data.series["v"][0] == pytest.approx(first, rel=1e-15)
    assert data.warnings == ()


@pytest.mark.parametrize("kind", WRITERS)
@pytest.mark.parametrize(
    ("stated", "unit"),
    [
        ("1/min", "rpm"),
        ("min^-1", "rad/s"),
        ("min-1", "deg/s"),
        ("Hz", "rad/s"),
        ("kHz", "rev/min"),
        ("1/s", "rad/s"),
        ("rpm", "Hz"),
        ("rad/s", "1/min"),
        ("1/s^2", "rad/s^2"),
    ],
)
def test_turns_are_never_taken_for_radians(
    tmp_path: Path, kind: str, stated: str, unit: str
) -> None:
    with pytest.raises(SpecError) as caught:
        read(tmp_path, kind, stated, unit)
    (fault,) = caught.value.diagnostics
    assert fault.code == "E0508"


@pytest.mark.parametrize("kind", WRITERS)
def test_a_unit_of_another_dimension_is_refused(tmp_path: Path, kind: str) -> None:
    with pytest.raises(SpecError, match="E0999"):
        read(tmp_path, kind, "kg", "m/s")


@pytest.mark.parametrize(
    ("stated", "unit", "expected"),
    [
        # a coulomb, a farad, henries, grams, pounds, nanometres, an angle
        ("C", "K", 309.15),
        ("F", "K", (36 + 459.67) * 5 / 9),
        ("J/kg/C", "J/kg/K", 36.0),
        ("km/H", "m/s", 10.0),
        ("g", "m/s^2", 36 * 9.80665),
        ("lb", "N", 36 * 0.45359237 * 9.80665),
        ("nm", "N*m", 36.0),
        ("deg", "K", 309.15),
        # nothing is like it: the numbers may be in the unit of the signal
        ("kg", "m/s", 36.0),
        # units that take no prefix
        ("krpm", "rpm", 36e3),
        ("mdeg/s", "deg/s", 0.036),
        ("KRPM", "rpm", 36e3),
        ("V/krpm", "V/rpm", 0.036),
        ("LBS", "kg", 36 * 0.45359237),
        # bar is like it, and no unit of the signal
        ("VAR", "W", 36.0),
    ],
)
def test_the_unit_that_is_advised_is_the_one_that_is_meant(
    tmp_path: Path, stated: str, unit: str, expected: float
) -> None:
    (tmp_path / "a.csv").write_text(f"time,v [{stated}]\n0,36\n0.1,37\n")
    layout = f'  time: time\n  columns: {{v: "v [{stated}]"}}\n'
    try:
        (found,) = load(tmp_path, "a.csv", unit, layout).warnings
    except SpecError as error:
        (found,) = error.diagnostics
    advised = re.findall(r"`(columns: \{.*?\}\})`", str(found.help))
    data = load(tmp_path, "a.csv", unit, f"  time: time\n  {advised[0]}\n")
    assert data.series["v"][0] == pytest.approx(expected, rel=1e-15)
    assert data.warnings == ()


@pytest.mark.parametrize("kind", WRITERS)
def test_the_spec_goes_before_the_file(tmp_path: Path, kind: str) -> None:
    data = read(tmp_path, kind, "km/h", "m/s", ", unit: cm/s")
    assert data.series["v"][0] == 0.36


@pytest.mark.parametrize(
    ("stated", "unit", "first", "codes"),
    [
        ("km/h", "m/s", 10.0, []),
        ("U/min", "rpm", 36.0, []),
        ("furlong/h", "m/s", 36.0, ["W0511"]),
    ],
)
def test_a_unit_with_which_a_workbook_shows_numbers_converts(
    tmp_path: Path, stated: str, unit: str, first: float, codes: list[str]
) -> None:
    write_xlsx_of_formats(tmp_path / "a.xlsx", stated)
    data = load(tmp_path, "a.xlsx", unit, "  time: time\n")
    assert data.series["v"][0] == first
    assert [warning.code for warning in data.warnings] == codes


@pytest.mark.parametrize("kind", [kind for kind in WRITERS if kind not in ("csv", "excel")])
@pytest.mark.parametrize("word", ["", "none", "n/a"])
def test_a_field_that_says_nothing_is_no_unit(tmp_path: Path, kind: str, word: str) -> None:
    data = read(tmp_path, kind, word, "m/s")
    assert data.series["v"].tolist() == V.tolist()
    assert data.warnings == ()


def test_readings_of_both_kinds_can_be_written_as_advised(tmp_path: Path) -> None:
    """600 1/min are 600 rpm, and 10 Hz as well."""
    name = "n.csv"
    for header, cell, turns, radians in (
        ("1/min", 600.0, "rev/min", "rad/min"),
        ("Hz", 10.0, "rev/s", "rad/s"),
    ):
        (tmp_path / name).write_text(f"time,v [{header}]\n0,{cell}\n0.1,{cell}\n")
        with pytest.raises(SpecError) as caught:
            load(tmp_path, name, "rpm", "  time: time\n")
        help = str(caught.value.diagnostics[0].help)
        assert f"`columns: {{v: {{column: 'v', unit: {turns}}}}}` for revolutions" in help
        assert f"`unit: {radians}` for radians" in help
        for unit, expected in ((turns, 600.0), (radians, 600 / (2 * np.pi))):
            layout = f"  time: time\n  columns: {{v: {{column: v, unit: {unit}}}}}\n"
            data = load(tmp_path, name, "rpm", layout)
            assert data.series["v"][0] == pytest.approx(expected, rel=1e-15)
    # the file has the angle: the declaration decides
    (tmp_path / name).write_text("time,v [rpm]\n0,600\n0.1,600\n")
    with pytest.raises(SpecError) as caught:
        load(tmp_path, name, "Hz", "  time: time\n")
    assert "declare `v` in `rev/s`" in str(caught.value.diagnostics[0].help)
    assert load(tmp_path, name, "rev/s", "  time: time\n").series["v"][0] == 10.0


def test_a_count_in_the_spec_is_asked_too(tmp_path: Path) -> None:
    (tmp_path / "n.csv").write_text("time,v\n0,600\n0.1,600\n")
    layout = "  time: time\n  columns: {v: {column: v, unit: 1/min}}\n"
    with pytest.raises(SpecError, match="E0508"):
        load(tmp_path, "n.csv", "rpm", layout)


def test_counts_without_angles_convert(tmp_path: Path) -> None:
    (tmp_path / "n.csv").write_text("time,v [1/min]\n0,600\n0.1,600\n")
    assert load(tmp_path, "n.csv", "Hz", "  time: time\n").series["v"][0] == 10.0


def test_a_name_and_a_field_that_differ_are_asked(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["v [km/h]"] = V
        file["v [km/h]"].attrs["units"] = "m/s"
    with pytest.raises(SpecError) as caught:
        load(tmp_path, "a.h5", "m/s")
    (fault,) = caught.value.diagnostics
    assert fault.code == "E0991"
    assert "`columns: {v: {column: 'v', unit: m/s}}`" in str(fault.help)
    data = load(tmp_path, "a.h5", "m/s", "  columns: {v: {column: v, unit: m/s}}\n")
    assert data.series["v"].tolist() == V.tolist()


def test_the_advice_of_two_units_in_a_text_is_right(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("time,v [km/h]\ns,m/s\n0,36\n0.1,37\n")
    with pytest.raises(SpecError, match="E0991"):
        load(tmp_path, "a.csv", "m/s", "  time: time\n")
    layout = "  time: time\n  columns: {v: {column: v, unit: m/s}}\n"
    assert load(tmp_path, "a.csv", "m/s", layout).series["v"].tolist() == [36.0, 37.0]


@pytest.mark.parametrize(("header", "unit", "first"), [("v", "%", 50.0), ("v", "1", 0.5)])
def test_cells_of_a_workbook_in_percent_are_ratios(
    tmp_path: Path, header: str, unit: str, first: float
) -> None:
    """A cell that shows 50 % holds 0.5."""
    write_percents(tmp_path / "a.xlsx", header)
    data = load(tmp_path, "a.xlsx", f'"{unit}"', "  time: time\n")
    assert data.series["v"][0] == first


def test_a_header_in_percent_over_cells_in_percent_is_asked(tmp_path: Path) -> None:
    write_percents(tmp_path / "a.xlsx", "v [%]")
    with pytest.raises(SpecError, match="E0991"):
        load(tmp_path, "a.xlsx", "1", "  time: time\n")
    layout = "  time: time\n  columns: {v: {column: v, unit: 1}}\n"
    assert load(tmp_path, "a.xlsx", "1", layout).series["v"][0] == 0.5


def write_percents(path: Path, header: str) -> None:
    book = openpyxl.Workbook()
    sheet = book.active
    assert sheet is not None
    for row in [("time", header), (0.0, 0.5), (0.1, 0.6)]:
        sheet.append(row)
    for row in (2, 3):
        sheet.cell(row, 2).number_format = "0%"
    book.save(path)


@pytest.mark.parametrize(
    ("names", "of_current", "of_phase"),
    [
        (("i", "I", "i_unit", "I_unit"), "A", "mA"),
        (("i", "I", "i_unit"), "", "mA"),
        (("I", "i_unit"), "mA", ""),
        (("i.data", "I.data", "i.unit", "I.Units"), "A", "mA"),
    ],
)
def test_names_that_differ_in_case_have_units_of_their_own(
    names: tuple[str, ...], of_current: str, of_phase: str
) -> None:
    texts = {name: "A" if name.startswith("I") else "mA" for name in names}
    ending = ".data" if "i.data" in names else ""
    for name, unit in ((f"I{ending}", of_current), (f"i{ending}", of_phase)):
        if name in names:
            found = unit_beside(names, name, texts.__getitem__)
            assert found == ([(unit,)] if unit else [])


@pytest.mark.parametrize(
    ("unit", "step"), [("ms", 100.0), ("milliseconds since 2026-01-01 00:00:00", 100.0)]
)
def test_time_of_a_file_has_the_unit_of_its_field(tmp_path: Path, unit: str, step: float) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["time"], file["v"] = step * np.arange(4), V
        file["time"].attrs["units"] = unit
    data = load(tmp_path, "a.h5", "m/s", "  time: time\n")
    assert data.episodes("train").tolist() == [[0, 4]]


def test_time_in_an_unknown_unit_is_reported(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["time"], file["v"] = TIME, V
        file["time"].attrs["units"] = "fortnights"
    (warning,) = load(tmp_path, "a.h5", "m/s", "  time: time\n").warnings
    assert warning.code == "W0511"
    assert "time: {column: 'time', unit: s}" in str(warning.help)


def test_a_unit_of_many_files_is_reported_once(tmp_path: Path) -> None:
    for number in range(3):
        write_hdf5(tmp_path / f"{number}.h5", "furlong/h")
    assert len(load(tmp_path, "'*.h5'", "m/s").warnings) == 1


FRAMES: dict[str, Callable[[str], Any]] = {
    "attrs of a frame": lambda unit: _with_attrs({"units": {"v": unit}}),
    "a header of pandas": lambda unit: pd.DataFrame({"time": TIME, f"v [{unit}]": V}),
    "a header of polars": lambda unit: pl.DataFrame({"time": TIME, f"v [{unit}]": V}),
    "attrs of a series": lambda unit: {"time": TIME, "v": _series(unit)},
    "pint": lambda unit: {"time": TIME, "v": pint.Quantity(V, unit)},
    "a text in the mapping": lambda unit: {"time": TIME, "v": V, "v_unit": unit},
}


def _with_attrs(attrs: Mapping[Hashable, Any]) -> pd.DataFrame:
    frame = pd.DataFrame({"time": TIME, "v": V})
    frame.attrs = {**attrs}
    return frame


def _series(unit: str) -> Any:
    series = pd.Series(V)
    series.attrs["unit"] = unit
    return series


@pytest.mark.parametrize("kind", FRAMES)
def test_a_unit_of_a_frame_converts(tmp_path: Path, kind: str) -> None:
    spec = tmp_path / "car.msnn.yaml"
    spec.write_text(SPEC.replace("UNIT", "m/s").replace("FILE", "none.csv") + "  time: time\n")
    model = msnn.load(spec)
    assert model.spec.data is not None
    data = frame_data(
        model.program, model.spec.data, FRAMES[kind]("km/h"), model.spec.data.place, {}
    )
    assert data.series["v"][0] == 10.0


@pytest.mark.parametrize("kind", ["ros1", "ros2"])
def test_messages_of_ros_have_the_units_of_their_definition(tmp_path: Path, kind: str) -> None:
    one = kind == "ros1"
    types = get_typestore(Stores.ROS1_NOETIC if one else Stores.LATEST)
    twist, vector, warmth, header, moment = (
        types.types[name]
        for name in (
            "geometry_msgs/msg/Twist",
            "geometry_msgs/msg/Vector3",
            "sensor_msgs/msg/Temperature",
            "std_msgs/msg/Header",
            "builtin_interfaces/msg/Time",
        )
    )
    name = "a.bag" if one else "run/run.db3"
    writer = Ros1Writer(tmp_path / name) if one else Ros2Writer(tmp_path / "run", version=9)
    with writer as bag:
        topics: list[Any] = [
            bag.add_connection(topic, of.__msgtype__, typestore=types)
            for topic, of in (("/speed", twist), ("/motor", warmth))
        ]
        for number, value in enumerate(V.tolist()):
            turning = vector(x=0.0, y=0.0, z=value)
            speed = twist(linear=vector(x=value, y=0.0, z=0.0), angular=turning)
            sequence = {"seq": number} if one else {}
            head = header(stamp=moment(sec=0, nanosec=0), frame_id="", **sequence)
            heat = warmth(header=head, temperature=value, variance=0.0)
            for topic, message in zip(topics, (speed, heat), strict=True):
                code = types.serialize_ros1 if one else types.serialize_cdr
                bag.write(topic, number * 10**8, code(message, message.__msgtype__))
    for column, unit, first in (
        ("/speed.linear.x", "km/h", 129.6),
        ("/speed.angular.z", "rpm", 36 * 30 / np.pi),
        ("/motor.temperature", "K", 309.15),
        ("/motor.variance", "K", 0.0),
    ):
        data = load(tmp_path, name, unit, f"  columns: {{v: {column}}}\n")
        assert data.series["v"][0] == pytest.approx(first, rel=1e-15)
    with pytest.raises(SpecError, match="E0999"):
        load(tmp_path, name, "N", "  columns: {v: /speed.linear.x}\n")

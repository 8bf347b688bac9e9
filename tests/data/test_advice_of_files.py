"""What a message about a data file advises is tried: with it the file is read."""

from __future__ import annotations

from itertools import permutations
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import pytest
from asammdf import MDF, Signal
from scipy.io import savemat

import msnn
from msnn.data.dataset import Dataset
from msnn.data.reading.frames import frame_data
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError
from tests.data.unit_files import SPEC, load

TIME = "  time: time\n"
ROWS = "0,1\n0.1,2\n0.2,3\n"
SEMICOLON = '  csv: {delimiter: ";"}\n'


def fault_of(folder: Path, layout: str, unit: str = "m/s", name: str = "a.csv") -> Diagnostic:
    with pytest.raises(SpecError) as caught:
        load(folder, name, unit, layout)
    return caught.value.diagnostics[0]


@pytest.mark.parametrize(
    ("text", "layout", "code", "keys"),
    [
        # keys of the message, in place of those of the spec
        (f"time,w\n{ROWS}", TIME, "E0804", "columns: {v: w}"),
        (f"# time,v\n{ROWS}", TIME, "E0804", 'time: "# time"'),
        ("time,v,v\n0,1,0\n0.1,2,0\n0.2,3,0\n", TIME, "E0814", "columns: {v: 1}"),
        ("time,time,v\n0,0,1\n0.1,0,2\n0.2,0,3\n", TIME, "E0814", "time: 0"),
        (
            "time,a,a\n0,1,0\n0.1,2,0\n0.2,3,0\n",
            TIME + "  columns: {v: a}\n",
            "E0814",
            "columns: {v: 1}",
        ),
        (ROWS, "  csv: {header: false}\n  time: 0\n", "E0804", "columns: {v: 0}"),
        # names with a dot, which are columns and no signals of a submodel
        (f"time,w\n{ROWS}", f"{TIME}  columns: {{v: car.z}}\n", "E0804", "columns: {v: w}"),
        (f"time;w\n{ROWS.replace(',', ';')}", TIME + SEMICOLON, "E0804", "columns: {v: w}"),
    ],
)
def test_the_key_that_is_advised_reads_the_file(
    tmp_path: Path, text: str, layout: str, code: str, keys: str
) -> None:
    (tmp_path / "a.csv").write_text(text)
    fault = fault_of(tmp_path, layout)
    assert fault.code == code
    # an example stands for the name of the column
    advised = str(fault.help).split("`")[1].replace("NAME", "w")
    assert advised == keys
    own = advised.split(":")[0]
    kept = [line for line in layout.splitlines() if not line.strip().startswith(own)]
    data = load(tmp_path, "a.csv", "m/s", "\n".join([*kept, f"  {advised}", ""]))
    # without header the only advice is how a column is named: its number here is that of the time
    assert data.series["v"].tolist() == ([0.0, 0.1, 0.2] if "header" in layout else [1, 2, 3])


@pytest.mark.parametrize("labels", [(10, 20), ("true", "1e3"), (1.5, 2.5)])
def test_labels_that_are_no_names_are_advised_in_quotes(tmp_path: Path, labels: Any) -> None:
    frame = pd.DataFrame({labels[0]: [1.0, 2.0], labels[1]: [3.0, 4.0]})

    def read(column: str) -> Dataset:
        text = SPEC.replace("UNIT", "m/s").replace("FILE", "none.csv")
        (tmp_path / "car.msnn.yaml").write_text(f"{text}  {column}\n")
        model = msnn.load(tmp_path / "car.msnn.yaml")
        section = model.spec.data
        assert section is not None
        return frame_data(model.program, section, frame, section.place, {})

    asked = str(labels[0])
    with pytest.raises(SpecError) as caught:
        read("columns: {v: " + (asked if asked == "10" else f'"{asked}x"') + "}")
    advised = str(caught.value.diagnostics[0].help).split("`")[1]
    assert advised == f'columns: {{v: "{asked}"}}'
    assert read(advised).series["v"].tolist() == [1.0, 2.0]


def test_a_column_that_stands_on_the_left_is_exchanged(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(f"time,v\n{ROWS}")
    fault = fault_of(tmp_path, TIME + "  columns: {v: speed}\n")
    assert fault.code == "E0804"
    assert "if the two are exchanged, write `columns: {speed: v}`" in str(fault.help)


def test_the_delimiter_that_is_advised_stands_beside_other_keys(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(f"# a log\ntime;v\n{ROWS.replace(',', ';')}")
    keys = '  csv: {comment: "#", delimiter: ","}\n'
    fault = fault_of(tmp_path, TIME + keys)
    assert fault.code == "E0805"
    advised = str(fault.help).split("`")[1]
    data = load(tmp_path, "a.csv", "m/s", TIME + keys.replace('delimiter: ","', advised))
    assert data.series["v"].tolist() == [1, 2, 3]


@pytest.mark.parametrize("picked", ["", "  from: 2026-10-25 02:00:02\n"])
def test_the_end_of_summer_time_is_named(tmp_path: Path, picked: str) -> None:
    times = [f"2026-10-25 02:{m}:{s:02}" for m, s in (("59", 58), ("59", 59), ("00", 0), ("00", 1))]
    (tmp_path / "a.csv").write_text("time,v\n" + "".join(f"{time},1\n" for time in times))
    layout = f"  time: time\n  resample: linear\n{picked}"
    fault = fault_of(tmp_path, layout)
    assert fault.code == "E0813"
    assert "row 2 of a.csv goes back by an hour: the end of summer time?" in fault.message
    zone = str(fault.help).split("`")[1]
    found = load(
        tmp_path, "a.csv", "m/s", f"  time: {{column: time, {zone}}}\n  resample: linear\n"
    )
    seconds = found.records[0].pieces[0].time
    assert seconds is not None
    assert seconds.tolist()[-1] == 3
    offsets = ("+02:00", "+02:00", "+01:00", "+01:00")
    text = "".join(f"{time}{zone},1\n" for time, zone in zip(times, offsets, strict=True))
    (tmp_path / "a.csv").write_text(f"time,v\n{text}")
    load(tmp_path, "a.csv", "m/s", "  time: time\n  resample: linear\n")


@pytest.mark.parametrize(
    ("name", "begin"),
    [
        ("a.tdms", b"TDSm"),
        ("a.h5", b"\x89HDF\r\n\x1a\n"),
        ("a.hdf5", b"\x89HDF\r\n\x1a\n"),
        ("a.mdf", b"MDF     "),
        ("a.mat", b"MATLAB 5.0"),
        ("a.bag", b"#ROSBAG V2.0\n"),
        ("a.mcap", b"\x89MCAP0\r\n"),
        ("a.db3", b"SQLite format 3\x00"),
        ("a.parquet", b"PAR1"),
    ],
)
def test_a_damaged_file_is_not_advised_the_name_that_it_has(
    tmp_path: Path, name: str, begin: bytes
) -> None:
    (tmp_path / name).write_bytes(begin + bytes(range(200)))
    layout = TIME if name in ("a.h5", "a.hdf5", "a.mat", "a.parquet") else ""
    fault = fault_of(tmp_path, layout, name=name)
    assert fault.code == "E0802"
    assert "copy the file again" in str(fault.help)
    assert "it is damaged" in fault.message


def test_a_binary_file_is_not_advised_another_encoding(tmp_path: Path) -> None:
    (tmp_path / "a.dat").write_bytes(bytes(range(256)))
    fault = fault_of(tmp_path, TIME, name="a.dat")
    assert fault.code == "E0802"
    assert "neither text nor of a format" in fault.message
    assert "iconv" not in str(fault.help)
    assert ".tdms" in str(fault.help)
    (tmp_path / "a.txt").write_bytes("time,v,Größe\n0,1,2\n".encode("latin-1"))
    assert "iconv" in str(fault_of(tmp_path, TIME, name="a.txt").help)


@pytest.mark.parametrize("asked", ["log.speed", "speed"])
def test_the_values_of_a_struct_are_advised(tmp_path: Path, asked: str) -> None:
    values = {"data": np.array([1.0, 2.0, 3.0]), "time": 0.1 * np.arange(3), "unit": "m/s"}
    savemat(tmp_path / "a.mat", {"log": {"speed": values}})
    fault = fault_of(tmp_path, f"  columns: {{v: {asked}}}\n", name="a.mat")
    assert fault.code == "E0804"
    advised = str(fault.help).split("`")[1]
    assert advised == 'columns: {v: "log.speed.data"}'
    assert load(tmp_path, "a.mat", "m/s", f"  {advised}\n").series["v"].tolist() == [1, 2, 3]


def test_rows_of_several_rates_are_not_advised_a_time_for_every(tmp_path: Path) -> None:
    with MDF(version="4.10") as file:
        for name, step in (("v", 0.1), ("w", 0.03)):
            file.append([Signal(np.arange(20.0), step * np.arange(20), name=name)])
        file.save(tmp_path / "a.mf4")
    layout = "  resample: linear\n"
    spec = SPEC.replace("inputs: {v: UNIT}", "inputs: {v: {}, w: {}}").replace("o: v", "o: v + w")
    text = spec.replace("FILE", "a.mf4") + layout
    program = tmp_path / "car.msnn.yaml"
    program.write_text(f"{text}  every: 2\n")
    with pytest.raises(SpecError, match="E0845") as caught:
        msnn.simulate(msnn.load(program))
    assert "remove `every:`" in str(caught.value.diagnostics[0].help)
    # the advice
    program.write_text(text)
    found = msnn.simulate(msnn.load(program)).to_frame()
    assert found["o"].tolist() == pytest.approx([13 / 3 * row for row in range(6)], rel=1e-12)


@pytest.mark.parametrize("cell", ["1e", "2.5E", "1e-"])
def test_a_number_without_the_digits_of_its_exponent_has_no_unit(tmp_path: Path, cell: str) -> None:
    (tmp_path / "a.csv").write_text(f"time,v\n0,1\n0.1,{cell}\n0.2,3\n")
    fault = fault_of(tmp_path, TIME)
    assert fault.code == "E0807"
    advised = str(fault.help).split("`")[1]
    (tmp_path / "a.csv").write_text(f"time,v\n0,1\n0.1,{advised}\n0.2,3\n")
    assert load(tmp_path, "a.csv", "m/s", TIME).series["v"][1] == float(advised)


@pytest.mark.parametrize(
    ("cell", "number"),
    [
        ('"1,234.5"', 1234.5),
        ('"-12,345,678"', -12345678.0),
        ("0x1F", 31.0),
        ("1.5D+01", 15.0),
        ("−5", -5.0),
        ("ON", 1.0),
        ("1'000", 1000.0),
        ("1 000", 1000.0),
    ],
)
def test_the_number_that_is_advised_is_read(tmp_path: Path, cell: str, number: float) -> None:
    (tmp_path / "a.csv").write_text(f"time,v\n0,{cell}\n", "utf-8")
    fault = fault_of(tmp_path, TIME)
    assert fault.code == "E0807"
    advised = str(fault.help).split("`")[1]
    (tmp_path / "a.csv").write_text(f"time,v\n0,{advised}\n")
    assert load(tmp_path, "a.csv", "m/s", TIME).series["v"].tolist() == [number]


def test_rows_that_end_with_a_separator_are_read_after_the_advice(tmp_path: Path) -> None:
    rows = "0,1,\n0.1,2,\n"
    (tmp_path / "a.csv").write_text(f"time,v\n{rows}")
    assert "behind the header" in str(fault_of(tmp_path, TIME).help)
    (tmp_path / "a.csv").write_text(f"time,v,\n{rows}")
    assert load(tmp_path, "a.csv", "m/s", TIME).series["v"].tolist() == [1, 2]
    # one cell too many that is not empty
    (tmp_path / "a.csv").write_text("time,v\n0,1,5\n")
    assert "quotes" in str(fault_of(tmp_path, TIME).help)


def test_decimal_commas_between_commas_are_no_matter_of_keys(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("time,v\n0,0,1,5\n0,1,2,5\n")
    fault = fault_of(tmp_path, TIME)
    assert fault.code == "E0806"
    key = str(fault.help).split("`")[-2]
    assert "save it with `;` between cells" in str(fault.help)
    (tmp_path / "a.csv").write_text("time;v\n0,0;1,5\n0,1;2,5\n")
    assert load(tmp_path, "a.csv", "m/s", f"{TIME}  {key}\n").series["v"].tolist() == [1.5, 2.5]


@pytest.mark.parametrize("name", ["a.csv", "a.npz"])
def test_a_column_without_any_value_is_no_matter_of_missing_ones(tmp_path: Path, name: str) -> None:
    """`nan: split` would leave no row."""
    if name == "a.csv":
        (tmp_path / name).write_text("time,v,w\n0,,1\n0.1,NaN,2\n0.2,,3\n")
    else:
        time, w = np.array([0, 0.1, 0.2]), np.array([1.0, 2, 3])
        np.savez(tmp_path / name, time=time, v=np.full(3, np.nan), w=w)
    fault = fault_of(tmp_path, TIME, name=name)
    assert fault.code == "E0809"
    assert "no value at all" in fault.message
    assert "nan:" not in str(fault.help)
    layout = TIME + "  columns: {v: w}\n"
    assert load(tmp_path, name, "m/s", layout).series["v"].tolist() == [1, 2, 3]


@pytest.mark.parametrize(
    ("unit", "declared", "advised"), [("C", "K", "degC"), ("kg", "m/s", "m/s"), ("lb", "N", "lbf")]
)
def test_a_unit_of_the_spec_that_does_not_convert_is_advised(
    tmp_path: Path, unit: str, declared: str, advised: str
) -> None:
    (tmp_path / "a.csv").write_text(f"time,v\n{ROWS}")
    layout = TIME + "  columns: {v: {column: v, unit: UNIT}}\n"
    fault = fault_of(tmp_path, layout.replace("UNIT", unit), declared)
    assert fault.code == "E0816"
    assert f"`unit: {advised}`" in str(fault.help)
    data = load(tmp_path, "a.csv", declared, layout.replace("UNIT", advised))
    assert len(data.series["v"]) == 3


@pytest.mark.parametrize("suffix", [".xlsx", ".h5", ".mat", ".parquet", ".npz", ".mf4", ".bag"])
def test_text_under_another_name_is_read_after_the_advice(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    path.write_text(f"time,v\n{ROWS * 100}")
    time = "" if suffix in (".mf4", ".bag") else TIME
    fault = fault_of(tmp_path, time, name=path.name)
    assert fault.code == "E0802"
    assert fault.help == "it is text: give it a name that ends in `.csv`"


def test_hdf5_under_another_name_is_read_after_the_advice(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["time"], file["v"] = [0.0, 0.1], [1.0, 2.0]
    (tmp_path / "a.npz").write_bytes((tmp_path / "a.h5").read_bytes())
    fault = fault_of(tmp_path, TIME, name="a.npz")
    assert "its format is HDF5: give it a name that ends in `.h5`" in str(fault.help)


def test_times_of_a_measurement_that_nobody_edits_are_no_rows_to_remove(tmp_path: Path) -> None:
    with MDF(version="4.10") as file:
        file.append([Signal(np.arange(4.0), np.array([0, 0.1, 0.1, 0.2]), name="v")])
        file.save(tmp_path / "a.mf4", overwrite=True)
    for layout in ("", "  resample: linear\n"):
        fault = fault_of(tmp_path, layout, name="a.mf4")
        assert fault.code == "E0813"
        assert "keep one" not in str(fault.help)
    with MDF(version="4.10") as file:
        clock = Signal(np.array([0, 0.1, 0.2, 0.3]), np.array([0, 0.1, 0.1, 0.2]), name="clock")
        file.append([Signal(np.arange(4.0), clock.timestamps, name="v"), clock])
        file.save(tmp_path / "a.mf4", overwrite=True)
    data = load(tmp_path, "a.mf4", "m/s", "  time: clock\n")
    assert data.series["v"].tolist() == [0, 1, 2, 3]


def test_a_clock_that_was_not_set_is_no_matter_of_spelling(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("time,v\n0001-01-01 00:00:00,1\n2026-11-22 17:00:00,2\n")
    assert "clock was not set" in str(fault_of(tmp_path, TIME).help)


@pytest.mark.parametrize("how", ["linear", "nearest"])
def test_a_slow_input_is_told_to_resample(tmp_path: Path, how: str) -> None:
    """Its empty cells lie between values at even steps; a lost value of another is missing."""
    rows = [f"{0.1 * k:.1f},{k if k % 3 == 0 else ''}" for k in range(13)]
    (tmp_path / "a.csv").write_text("\n".join(["time,v", *rows]) + "\n")
    fault = fault_of(tmp_path, TIME)
    assert fault.code == "E0809"
    assert "`resample: linear`, or `nearest`" in str(fault.help)
    data = load(tmp_path, "a.csv", "m/s", TIME + f"  resample: {how}\n")
    assert data.usable.all()
    assert data.rows == 13
    rows[4] = "0.4,4"
    (tmp_path / "a.csv").write_text("\n".join(["time,v", *rows[3:6]]) + "\n")
    assert "resample" not in str(fault_of(tmp_path, TIME).help)


@pytest.mark.parametrize("unit", ["ms", "us", "min"])
def test_a_unit_of_the_time_that_is_wrong_is_told(tmp_path: Path, unit: str) -> None:
    (tmp_path / "a.csv").write_text("time [s],v\n0,1\n0.1,2\n0.2,3\n")
    fault = fault_of(tmp_path, f"  time: {{column: time, unit: {unit}}}\n")
    assert fault.code == "E0812"
    assert fault.help == "if the time is in s, write `time: {column: time, unit: s}`"
    assert load(tmp_path, "a.csv", "m/s", "  time: {column: time, unit: s}\n").rows == 3


SECONDS_OF = {"ns": 1e-9, "us": 1e-6, "ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0, "d": 86400.0}


@pytest.mark.parametrize(
    ("read", "true", "stated"),
    [
        (read, true, stated)
        for read, true in permutations(SECONDS_OF, 2)
        for stated in (["nowhere"] if read == "s" else ["header", "spec"])
    ],
)
def test_every_wrong_unit_of_the_time_is_named(
    tmp_path: Path, read: str, true: str, stated: str
) -> None:
    """The advice is to write the true unit, never `every: 1000`; written, it reads the file."""
    header = f"time [{read}]" if stated == "header" else "time"
    rows = [f"{0.1 * k / SECONDS_OF[true]!r},{k}\n" for k in range(40)]
    (tmp_path / "a.csv").write_text(f"{header},v\n{''.join(rows)}")
    key = f"{{column: time, unit: {read}}}" if stated == "spec" else "time"
    fault = fault_of(tmp_path, f"  time: {key}\n")
    repair = f"time: {{column: time, unit: {true}}}"
    assert fault.code == "E0812"
    assert f"if the time is in {true}, write `{repair}`" in str(fault.help)
    # one row in 60 or more would leave none of the 40
    assert "every" not in str(fault.help) or "`every: 24`" in str(fault.help)
    assert load(tmp_path, "a.csv", "m/s", f"  {repair}\n").rows == 40


@pytest.mark.parametrize(
    ("step", "rows", "keys", "repair"),
    [
        (0.01, 40, "", "`every: 10` takes one row in 10"),
        # the rows of the file count, not those that `every:` leaves
        (0.01, 40, "  every: 5\n", "`every: 10` takes one row in 10"),
        (0.0001, 40, "", "write `sample_time: 0.1 ms`"),
        (
            0.0001,
            2000,
            "",
            (
                "write `sample_time: 0.1 ms` if its unit is wrong; else `every: 1000` takes one "
                "row in 1000"
            ),
        ),
        (0.01, 8, "", "write `sample_time: 10 ms`, or bring the rows to it by `resample:`"),
    ],
)
def test_rows_are_left_out_where_enough_remain(
    tmp_path: Path, step: float, rows: int, keys: str, repair: str
) -> None:
    lines = [f"{step * k:.6f},{k}\n" for k in range(rows)]
    (tmp_path / "a.csv").write_text(f"time,v\n{''.join(lines)}")
    fault = fault_of(tmp_path, TIME + keys)
    assert (fault.code, fault.help) == ("E0812", repair)


DATES = "time,v\n" + "".join(f"2026-11-22 17:00:0{0.1 * k:.1f}ZONE,{k}\n" for k in range(10))


@pytest.mark.parametrize(
    ("text", "late", "covered"),
    [
        (f"time,v\n{ROWS}", "7 s", ("0 s", "0.2 s")),
        (
            DATES.replace("ZONE", ""),
            "2026-11-23",
            ("2026-11-22 17:00:00", "2026-11-22 17:00:00.900"),
        ),
        (
            DATES.replace("ZONE", "+01:00"),
            "2026-11-23 00:00Z",
            ("2026-11-22 16:00:00Z", "2026-11-22 16:00:00.900Z"),
        ),
    ],
)
def test_times_outside_of_the_data_are_told_with_those_inside(
    tmp_path: Path, text: str, late: str, covered: tuple[str, str]
) -> None:
    (tmp_path / "a.csv").write_text(text)
    fault = fault_of(tmp_path, f"{TIME}  from: {late}\n")
    assert fault.code == "E0818"
    assert fault.message.endswith(f"which has times {covered[0]} … {covered[1]}")
    assert load(tmp_path, "a.csv", "m/s", f"{TIME}  from: {covered[0]}\n").rows > 2
    end = late.replace("-23", "-24").replace("7 s", "8 s")
    split = "  split: {by: time, val: [FROM, TO]}\n"
    data = load(tmp_path, "a.csv", "m/s", TIME + split.replace("FROM", late).replace("TO", end))
    (told,) = (one for one in data.warnings if one.code == "W0833")
    assert told.message.endswith(f"the data are from {covered[0]} to {covered[1]}")
    assert told.help == "choose a time within the data"
    inside = split.replace("FROM", covered[0]).replace("TO", covered[1])
    assert load(tmp_path, "a.csv", "m/s", TIME + inside).has("val")


@pytest.mark.parametrize("date", ["2026/11/22 17:00:00", "2026.11.22 17:00:00", "22.11.2026"])
def test_dates_of_other_forms_are_told_the_one_that_is_read(tmp_path: Path, date: str) -> None:
    (tmp_path / "a.csv").write_text(f"time,v\n{date},1\n")
    fault = fault_of(tmp_path, TIME)
    assert (fault.code, "`2026-11-22 17:00:00.25` (ISO 8601)" in str(fault.help)) == ("E0807", True)


@pytest.mark.parametrize("csv", ["", '  csv: {delimiter: ";", decimal: ","}\n'])
def test_points_between_thousands_beside_decimal_commas_are_told(tmp_path: Path, csv: str) -> None:
    (tmp_path / "a.csv").write_text("time;v\n0;1.234,5\n0,1;-1.234.567,25\n")
    layout = TIME + (csv or '  csv: {delimiter: ";"}\n')
    if not csv:
        (tmp_path / "a.csv").write_text("time;v\n0;1.234,5\n0.1;-1.234.567,25\n")
    fault = fault_of(tmp_path, layout)
    point, key = str(fault.help).split("`")[1:4:2]
    assert (fault.code, point) == ("E0807", "1234.5")
    (tmp_path / "a.csv").write_text("time;v\n0;1.234,5\n0,1;-1.234.567,25\n")
    read = load(tmp_path, "a.csv", "m/s", TIME + f"  {key}\n")
    assert read.series["v"].tolist() == [1234.5, -1234567.25]


def test_a_list_with_none_is_told_how_to_become_numbers() -> None:
    model = msnn.load(
        "msnn: 1\nname: p\nsample_time: 0.1 s\ninputs: {v: {}}\noutputs: {o: {expr: v}}\n"
        "data: {source: {train: a.csv}, nan: split}\n"
    )
    values: Any = [1.0, 2.0, None]
    with pytest.raises(SpecError) as caught:
        msnn.simulate(model, {"v": values})
    (fault,) = caught.value.diagnostics
    assert (fault.code, "`np.asarray(…, float)`" in fault.message) == ("E0840", True)
    (run,) = msnn.simulate(model, {"v": np.asarray(values, float)})
    assert run.outputs["o"].tolist() == [1.0, 2.0]

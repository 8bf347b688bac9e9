"""Rule R10: every key of `data:` has an effect on files of every format, or a diagnostic."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import openpyxl
import pyarrow as arrow
import pyarrow.parquet as parquet
import pytest
from asammdf import MDF, Signal
from nptdms import ChannelObject, TdmsWriter
from numpy.typing import NDArray
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.typesys import Stores, get_typestore
from scipy.io import savemat

from msnn.data.formats.table_of_formats import FORMATS, format_of
from msnn.data.reading.files import data_of_files
from msnn.data.reading.load import load_data
from msnn.data.reading.row_filter import row_filters
from msnn.model.load import load_model
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.sections.data import Column, Csv, Data, Source, Split, TimeColumn
from tests.data import ulog_files as ulog

Values = NDArray[np.float64]
Writer = Callable[[Path, Values, Values, Values], None]

SPEC = """
msnn: 1
name: plant
sample_time: 0.2 s
inputs: {x: m, F: N}
outputs: {y: "x * 2", z: "F * 2"}
data:
"""


def write_csv(path: Path, time: Values, x: Values, force: Values) -> None:
    rows = [f"{t!r},{a!r},{b!r}" for t, a, b in zip(*map(list, (time, x, force)), strict=True)]
    path.write_text("\n".join(["time,x,F", *rows]).replace("np.float64(", "").replace(")", ""))


def write_xlsx(path: Path, time: Values, x: Values, force: Values) -> None:
    book = openpyxl.Workbook()
    sheet: Any = book.worksheets[0]
    sheet.append(["time", "x", "F"])
    for row in zip(time.tolist(), x.tolist(), force.tolist(), strict=True):
        sheet.append([None if np.isnan(value) else value for value in row])
    book.save(path)


def write_hdf5(path: Path, time: Values, x: Values, force: Values) -> None:
    with h5py.File(path, "w") as file:
        file["time"], file["x"], file["F"] = time, x, force


def write_mdf(path: Path, time: Values, x: Values, force: Values) -> None:
    with MDF(version="4.10") as file:
        file.append([Signal(x, time, name="x"), Signal(force, time, name="F")])
        file.save(path, overwrite=True)


def write_bag(path: Path, time: Values, x: Values, force: Values) -> None:
    types = get_typestore(Stores.LATEST)
    known = types.types
    with BagWriter(path, version=9) as bag:
        kind = known["geometry_msgs/msg/Vector3Stamped"]
        connection = bag.add_connection("/motion", kind.__msgtype__, typestore=types)
        for t, a, b in zip(time, x, force, strict=True):
            now = int(5e9 + round(t * 1e9))
            stamp = known["builtin_interfaces/msg/Time"](now // 10**9, now % 10**9)
            header = known["std_msgs/msg/Header"](stamp, "")
            message = kind(header, known["geometry_msgs/msg/Vector3"](x=a, y=b, z=float(t)))
            # recorded late, and never equally late
            late = int(1e7 * (1 + 0.01 * np.sin(now)))
            bag.write(connection, now + late, types.serialize_cdr(message, kind.__msgtype__))


def write_tdms(path: Path, time: Values, x: Values, force: Values) -> None:
    dates = np.datetime64("2026-11-22T17:00:00") + (1e6 * time).astype("timedelta64[us]")
    columns = {"time": dates, "x": x, "F": force}.items()
    with TdmsWriter(path) as writer:
        writer.write_segment([ChannelObject("Run", name, values) for name, values in columns])


def write_ulog(path: Path, time: Values, x: Values, force: Values) -> None:
    fields = "uint64_t timestamp;double x;double y;double z;"
    begin = ulog.header() + ulog.topic_format("motion", fields) + ulog.subscription(0, "motion")
    rows = zip(time.tolist(), x.tolist(), force.tolist(), strict=True)
    start = ulog.START
    steps = [ulog.data(0, "Qddd", start + round(1e6 * t), a, b, t + a / 99) for t, a, b in rows]
    path.write_bytes(begin + b"".join(steps))


WRITERS: dict[str, Writer] = {
    "csv": write_csv,
    "xlsx": write_xlsx,
    "npz": lambda path, time, x, force: np.savez(path, time=time, x=x, F=force),
    "parquet": lambda path, time, x, force: parquet.write_table(
        arrow.table({"time": time, "x": x, "F": force}), path, row_group_size=5
    ),
    "mat": lambda path, time, x, force: savemat(path, {"time": time, "x": x, "F": force}),
    "h5": write_hdf5,
    "mf4": write_mdf,
    "db3": write_bag,
    "tdms": write_tdms,
    "ulg": write_ulog,
}
FIELDS = {"db3": "/motion.vector", "ulg": "motion"}
"""The message whose fields are the columns, of formats that have messages."""
KEEPING_TIME = ("mf4", "db3", "tdms", "ulg")


def test_every_format_is_written() -> None:
    assert {format_of(f"a.{kind}").name for kind in WRITERS} == {format.name for format in FORMATS}


@dataclass(frozen=True)
class Case:
    """A key with a value that matters for the sample; `without` is the section it is compared with.

    The sample has 12 rows, 0.2 s apart but for half a percent, in one file or in two.
    """

    section: str
    without: str | None = None
    lost: bool = False
    """Whether one value of x is missing."""
    marked: bool = False
    """Whether one value of x is −9999."""
    gap: bool = False
    """Whether a second is missing in the middle."""
    repeated: bool = False
    """Whether a row has the time of the row before."""


CASES: dict[str, Case] = {
    "Data.from": Case("from: 0.5 s\n"),
    "Data.to": Case("to: 0.5 s\n"),
    "Data.every": Case("every: 2\nresample: none\n", "resample: none\n"),
    "Data.columns": Case("columns: {x: F, F: F}\n"),
    "Data.time": Case("time: nonsense\n", ""),
    "Data.csv": Case('csv: {delimiter: ";"}\n'),
    "Data.resample": Case("resample: linear\n"),
    "Data.gap": Case("resample: linear\ngap: 10\n", "resample: linear\n", gap=True),
    "Data.join": Case("join: true\n"),
    "Data.filter": Case('filter: "x > 0.5"\n'),
    "Data.records": Case("records: row_group\n"),
    "Data.source": Case(""),
    "Data.split": Case("split: {val: 0.5}\n"),
    "Data.nan": Case("nan: split\n", lost=True),
    "Data.keep": Case("keep: disk\n"),
    "Data.duplicates": Case("duplicates: last\n", repeated=True),
    "Data.missing": Case("missing: -9999\n", marked=True),
    "Column.missing": Case("columns: {x: {column: x, missing: -9999}, F: F}\n", marked=True),
    "TimeColumn.column": Case("time: {column: nonsense}\n", ""),
    "TimeColumn.format": Case('time: {column: time, format: "%d.%m.%Y %H:%M:%S"}\n'),
    "TimeColumn.zone": Case("time: {column: time, zone: Europe/Berlin}\n"),
    "TimeColumn.unit": Case("time: {column: time, unit: ms}\n"),
    "Csv.delimiter": Case('csv: {delimiter: ";"}\n'),
    "Csv.decimal": Case('csv: {decimal: ","}\n'),
    "Csv.thousands": Case('csv: {thousands: ","}\n'),
    "Csv.comment": Case("csv: {comment: t}\n"),
    "Csv.header": Case("csv: {header: false}\n"),
    "Csv.skip": Case("csv: {skip: 1}\n"),
    "Column.column": Case("columns: {x: F, F: F}\n"),
    "Column.unit": Case("columns: {x: {column: x, unit: mm}, F: F}\n"),
    "Column.scale": Case("columns: {x: {column: x, scale: 2}, F: F}\n"),
    "Column.offset": Case("columns: {x: {column: x, offset: 2}, F: F}\n"),
    "Split.by": Case("split: {by: fraction, val: 0.5}\n", "split: {val: 0.5}\n"),
    "Split.train": Case("split: {train: 0.5, val: 0.5}\n"),
    "Split.val": Case("split: {val: 0.5}\n"),
    "Split.test": Case("split: {test: 0.5}\n"),
    "Split.blocks": Case(
        "split: {by: block, blocks: 6, val: [1]}\n", "split: {by: block, blocks: 2, val: [1]}\n"
    ),
    "Split.k": Case("split: {by: kfold, k: 3}\n", "split: {by: kfold, k: 2}\n"),
    "Split.fold": Case("split: {by: kfold, k: 2, fold: 2}\n", "split: {by: kfold, k: 2}\n"),
    "gap without resampling": Case("gap: 10\n"),
    # other values that say something
    "duplicates of streams": Case("resample: linear\nduplicates: mean\n", repeated=True),
    "duplicates that differ": Case(
        "resample: linear\nduplicates: mean\n",
        "resample: linear\nduplicates: first\n",
        repeated=True,
    ),
    "duplicates refused": Case(
        "resample: none\nduplicates: error\n", "resample: none\n", repeated=True
    ),
    "resample nearest": Case("resample: nearest\n"),
    "resample none": Case("resample: none\n", gap=True),
    "nan drop": Case("nan: drop\n", lost=True),
    "from a row": Case("from: 3\n"),
    "a split by time": Case("split: {by: time, val: [0 s, 1 s]}\n"),
}


def test_every_key_of_the_section_has_a_case() -> None:
    entries = (Data, TimeColumn, Csv, Column, Split)
    known = {
        f"{entry.__name__}.{field.alias or name}"
        for entry in entries
        for name, field in entry.model_fields.items()
        if name != "place"
    }
    assert known <= CASES.keys()
    # a source has the keys of the section and its files
    assert Source.model_fields.keys() - Data.model_fields.keys() == {"files"}


def outcome(folder: Path, section: str) -> object:
    """The data of a section, or its diagnostics, as values that compare."""
    (folder / "plant.yaml").write_text(SPEC + "".join(f"  {x}\n" for x in section.splitlines()))
    try:
        model = load_model(folder / "plant.yaml")
        assert model.spec.data is not None
        data = load_data(model.program, model.spec.data, folder, row_filters(model.spec))
    except SpecError as error:
        return sorted({found.code for found in error.diagnostics})
    pieces = [piece for record in data.records for piece in record.pieces]
    series = {name: np.asarray(values).tolist() for name, values in data.series.items()}
    times = [None if piece.time is None else np.asarray(piece.time).tolist() for piece in pieces]
    return repr(
        (
            series,
            times,
            [list(piece.rows) for piece in pieces],
            data.set_of_row.tolist(),
            data.sets,
            data.continues.tolist(),
            data.usable.tolist(),
            [(record.start, record.stop) for record in data.records],
            data.is_on_disk,
            [warning.code for warning in data.warnings],
        )
    )


def written(folder: Path, kind: str, case: Case) -> str:
    """Writes the sample, and returns the lines of the section that name it and its columns."""
    generator = np.random.default_rng(1)
    time = 0.2 * np.arange(12) + generator.uniform(-5e-4, 5e-4, 12)
    x, force = np.sin(3 * time), np.cos(time)
    if case.lost:
        x[5] = np.nan
    if case.marked:
        x[5] = -9999
    if case.repeated:
        time[4] = time[3]
    if case.gap:
        time[3:] += 1.0
    names: list[str] = []
    for number, half in enumerate((slice(0, 6), slice(6, 12))):
        name = f"{'ab'[number]}.{kind}"
        path = folder / name.removesuffix(".db3")
        if path.is_dir():
            shutil.rmtree(path)
        WRITERS[kind](path, time[half], x[half], force[half])
        names.append(f"{name.removesuffix('.db3')}/{name}" if kind == "db3" else name)
    return f"source: {{train: [{', '.join(names)}]}}\n"


def for_kind(section: str, kind: str) -> str:
    """The section with the names that the columns of a format have."""
    if kind in FIELDS:
        message = FIELDS[kind]
        section = section.replace("{x: F, F: F}", f"{{x: {message}.y, F: {message}.y}}")
        section = section.replace("column: x", f"column: {message}.x")
        section = section.replace("F: F}", f"F: {message}.y}}")
        section = section.replace("column: time", f"column: {message}.z")
        if "columns:" not in section:
            section += f"columns: {{x: {message}.x, F: {message}.y}}\n"
    if "time:" not in section and kind not in KEEPING_TIME:
        section += "time: time\n"
    return section


@pytest.mark.parametrize("kind", WRITERS)
def test_every_key_has_an_effect_or_a_diagnostic(tmp_path: Path, kind: str) -> None:
    ignored: list[str] = []
    for name, case in CASES.items():
        source = written(tmp_path, kind, case)
        found = outcome(tmp_path, source + for_kind(case.section, kind))
        if found == outcome(tmp_path, source + for_kind(case.without or "", kind)):
            ignored.append(name)
    # the files themselves are in both
    assert ignored == ["Data.source"]


@pytest.mark.parametrize("kind", [kind for kind in WRITERS if kind not in KEEPING_TIME])
@pytest.mark.parametrize(
    "section", ["resample: none\n", "join: true\n", "duplicates: last\n", "duplicates: error\n"]
)
def test_a_key_that_needs_times_says_so(tmp_path: Path, kind: str, section: str) -> None:
    source = written(tmp_path, kind, Case(section))
    assert outcome(tmp_path, source + section) == ["E0876"]
    assert isinstance(outcome(tmp_path, source), str)


def test_a_unit_that_converts_nothing_is_told(tmp_path: Path) -> None:
    source = written(tmp_path, "csv", Case(""))
    text = SPEC.replace("x: m, F: N", "x: {}, F: N") + f"  {source}  time: time\n"
    (tmp_path / "plant.yaml").write_text(text + "  columns: {x: {column: x, unit: mm}}\n")
    model = load_model(tmp_path / "plant.yaml")
    assert model.spec.data is not None
    data = load_data(model.program, model.spec.data, tmp_path)
    assert [warning.code for warning in data.warnings] == ["W0831"]


def test_a_comma_is_not_both_decimal_sign_and_separator(tmp_path: Path) -> None:
    source = written(tmp_path, "csv", Case(""))
    assert outcome(tmp_path, source + 'time: time\ncsv: {decimal: ","}\n') == ["E0877"]


def test_keys_of_the_files_of_the_spec_do_not_count_for_given_ones(tmp_path: Path) -> None:
    """`--data` names other files, which may be of another format."""
    source = written(tmp_path, "csv", Case(""))
    written(tmp_path, "npz", Case(""))
    outcome(tmp_path, source + 'time: time\nrecords: file\ncsv: {skip: 0, delimiter: ","}\n')
    model = load_model(tmp_path / "plant.yaml")
    assert model.spec.data is not None
    given = data_of_files(model.spec.data, [tmp_path / "a.npz"])
    assert load_data(model.program, given, tmp_path).rows == 6

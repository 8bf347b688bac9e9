"""Writes data files that state units, one writer for each format, and reads them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import openpyxl
import pandas as pd
import pyarrow as arrow
import pyarrow.parquet as parquet
from asammdf import MDF, Signal
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat

import msnn
from msnn.data.dataset import Dataset
from msnn.data.formats.table_of_formats import format_of
from msnn.data.reading.load import load_data

TIME = 0.1 * np.arange(4)
V = np.array([36.0, 37.0, 38.0, 39.0])
"""The numbers in the file."""

SPEC = """\
msnn: 1
name: car
sample_time: 0.1 s
inputs: {v: UNIT}
outputs: {o: v}
data:
  source: {train: FILE}
"""


def write_csv(path: Path, unit: str) -> None:
    rows = "".join(f"{t!r},{v!r}\n" for t, v in zip(TIME.tolist(), V.tolist(), strict=True))
    path.write_text(f"time,v [{unit}]\n{rows}", "utf-8")


def write_xlsx(path: Path, unit: str) -> None:
    book = openpyxl.Workbook()
    sheet = book.active
    assert sheet is not None
    for row in [("time", f"v ({unit})"), *zip(TIME.tolist(), V.tolist(), strict=True)]:
        sheet.append(row)
    book.save(path)


def write_xlsx_of_formats(path: Path, unit: str) -> None:
    book = openpyxl.Workbook()
    sheet = book.active
    assert sheet is not None
    for row in [("time", "v"), *zip(TIME.tolist(), V.tolist(), strict=True)]:
        sheet.append(row)
    for row in range(2, 2 + len(V)):
        sheet.cell(row, 2).number_format = f'0.0" {unit}"'
    book.save(path)


def write_npz(path: Path, unit: str) -> None:
    np.savez(path, time=TIME, v=V, v_unit=unit)


def write_parquet(path: Path, unit: str) -> None:
    column = arrow.field("v", arrow.float64(), metadata={"unit": unit})
    schema = arrow.schema([arrow.field("time", arrow.float64()), column])
    parquet.write_table(arrow.table([TIME, V], schema=schema), path)


def write_parquet_of_pandas(path: Path, unit: str) -> None:
    frame = pd.DataFrame({"time": TIME, "v": V})
    frame.attrs = {"units": {"v": unit}}
    frame.to_parquet(path)


def write_parquet_of_a_table(path: Path, unit: str) -> None:
    table = arrow.table({"time": TIME, "v": V})
    units = json.dumps({"v": unit})
    parquet.write_table(table.replace_schema_metadata({"units": units}), path)


def write_mat(path: Path, unit: str) -> None:
    savemat(path, {"time": TIME, "v": V, "v_unit": unit})


def write_mat_of_structs(path: Path, unit: str) -> None:
    savemat(path, {"time": TIME, "log": {"v": {"data": V, "time": TIME, "units": unit}}})


def write_mat_7_3(path: Path, unit: str) -> None:
    with h5py.File(path, "w", userblock_size=512) as file:
        file["time"], file["log/v/Value"] = TIME[None], V[None]
        letters = np.array([[ord(letter)] for letter in unit], np.uint16)
        file["log/v/Unit"] = letters
        file["log/v/Unit"].attrs["MATLAB_class"] = np.bytes_("char")


def write_hdf5(path: Path, unit: str) -> None:
    with h5py.File(path, "w") as file:
        file["time"], file["v"] = TIME, V
        file["v"].attrs["units"] = unit


def write_hdf5_of_bytes(path: Path, unit: str) -> None:
    with h5py.File(path, "w") as file:
        file["time"], file["v"] = TIME, V
        file["v"].attrs["Unit"] = np.bytes_(unit.encode())


def write_hdf5_of_columns(path: Path, unit: str) -> None:
    with h5py.File(path, "w") as file:
        file["time"], file["both"] = TIME, np.stack((V, V), axis=1)
        file["both"].attrs["units"] = ["N", unit]


def write_mdf(path: Path, unit: str) -> None:
    with MDF(version="4.10") as file:
        file.append([Signal(V, TIME, name="v", unit=unit)])
        file.save(path, overwrite=True)


def write_tdms(path: Path, unit: str) -> None:
    properties = {"wf_increment": 0.1, "unit_string": unit}
    with TdmsWriter(path) as writer:
        writer.write_segment([ChannelObject("Run", "v", V, properties)])


WRITERS: dict[str, tuple[str, Callable[[Path, str], None], str]] = {
    "csv": ("a.csv", write_csv, "v"),
    "excel": ("a.xlsx", write_xlsx, "v"),
    "npz": ("a.npz", write_npz, "v"),
    "parquet": ("a.parquet", write_parquet, "v"),
    "parquet of pandas": ("a.parquet", write_parquet_of_pandas, "v"),
    "parquet of a table": ("a.parquet", write_parquet_of_a_table, "v"),
    "mat": ("a.mat", write_mat, "v"),
    "mat of structs": ("a.mat", write_mat_of_structs, "log.v.data"),
    "mat 7.3": ("a.mat", write_mat_7_3, "log.v.Value"),
    "hdf5": ("a.h5", write_hdf5, "v"),
    "hdf5 of bytes": ("a.h5", write_hdf5_of_bytes, "v"),
    "hdf5 of columns": ("a.h5", write_hdf5_of_columns, "both[1]"),
    "mdf": ("a.mf4", write_mdf, "v"),
    "tdms": ("a.tdms", write_tdms, "v"),
}
"""The file's name, its writer, and the column in it."""


def load(folder: Path, name: str, unit: str, layout: str = "") -> Dataset:
    spec = folder / "car.msnn.yaml"
    spec.write_text(SPEC.replace("UNIT", unit).replace("FILE", name) + layout)
    model = msnn.load(spec)
    assert model.spec.data is not None
    return load_data(model.program, model.spec.data, folder)


def read(folder: Path, kind: str, stated: str, unit: str, said: str = "") -> Dataset:
    """The data of a file that states a unit, for a signal in another one."""
    name, write, column = WRITERS[kind]
    write(folder / name, stated)
    time = "" if format_of(name).keeps_time else "  time: time\n"
    if kind in ("csv", "excel"):
        # a header of which nobody knows the unit is a name as it stands
        column = f"v [{stated}]" if kind == "csv" else f"v ({stated})"
    entry = f'{{column: "{column}"{said}}}'
    return load(folder, name, unit, f"{time}  columns: {{v: {entry}}}\n")

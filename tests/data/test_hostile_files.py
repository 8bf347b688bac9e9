"""Broken files, and files made to harm, are refused: none ends the command or fills memory."""

from __future__ import annotations

import os
import random
import resource
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import numpy as np
import openpyxl
import pyarrow as arrow
import pyarrow.parquet as parquet
import pytest
from asammdf import MDF, Signal
from scipy.io import savemat

from msnn.data.formats.isolation import reader as isolation
from msnn.data.formats.table import ColumnTable, WantedColumns
from msnn.data.formats.table_of_formats import format_of
from msnn.data.formats.text.csv_header import LONGEST_LINE, Dialect
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError
from tests.data.specs import load

TIME = 0.2 * np.arange(60)
WANTED = WantedColumns({"x": "`x`", "F": "`F`"})


def write_mdf(path: Path) -> None:
    with MDF(version="4.10") as file:
        file.append([Signal(np.sin(TIME), TIME, name="x"), Signal(TIME, TIME, name="F")])
        file.save(path, overwrite=True)


def fault(folder: Path, file: str) -> Diagnostic:
    with pytest.raises(SpecError) as caught:
        load(folder, f"source: {{train: {file}}}\n")
    (found,) = caught.value.diagnostics
    assert found.code == "E0802"
    return found


def test_a_file_that_ends_its_reader_is_unreadable_and_the_next_is_read(tmp_path: Path) -> None:
    write_mdf(tmp_path / "a.mf4")
    damaged = bytearray((tmp_path / "a.mf4").read_bytes())
    # the offset of the last channel in its records: far outside of them
    at = damaged.rindex(b"##CN") + 92
    damaged[at : at + 4] = b"\xff" * 4
    (tmp_path / "b.mf4").write_bytes(damaged)
    assert "it ended its reader (SIGSEGV)" in fault(tmp_path, "b.mf4").message
    np.testing.assert_array_equal(load(tmp_path, "source: {train: a.mf4}\n").series["F"], TIME)


@pytest.mark.parametrize("kind", ["mf4", "mat", "h5"])
def test_no_damaged_file_ends_the_command(tmp_path: Path, kind: str) -> None:
    """Of 200 files a kind as these, one MAT file of version 5 ended scipy's reader."""
    match kind:
        case "mf4":
            write_mdf(tmp_path / f"a.{kind}")
        case "mat":
            savemat(tmp_path / f"a.{kind}", {"x": np.sin(TIME), "F": TIME})
        case _:
            import h5py

            with h5py.File(tmp_path / f"a.{kind}", "w") as file:
                file["x"], file["F"] = np.sin(TIME), TIME
    whole = (tmp_path / f"a.{kind}").read_bytes()
    read = format_of(f"b.{kind}").reader
    refused: list[str] = []
    for seed in range(40):
        generator, damaged = random.Random(seed), bytearray(whole)
        if seed % 4 == 0:
            damaged = damaged[: generator.randrange(len(damaged))]
        for _ in range(generator.choice((1, 3, 20)) if seed % 4 else 0):
            damaged[generator.randrange(len(damaged))] = generator.randrange(256)
        (tmp_path / f"b.{kind}").write_bytes(damaged)
        try:
            read(tmp_path / f"b.{kind}", "b", WANTED, Dialect())
        except SpecError as error:
            refused += [found.code for found in error.diagnostics]
    # half of all bytes are numbers, of which any is one
    assert 10 < len(refused) < 40
    assert all(code.startswith("E08") for code in refused)


def read(path: Path, shown: str, wanted: WantedColumns, dialect: Dialect) -> ColumnTable:
    """A reader for the tests below, which does what the name of its file says."""
    del shown, dialect
    match path.name:
        case "endless":
            while True:
                pass
        case "library":
            assert resource.getrlimit(resource.RLIMIT_AS)[0] != resource.RLIM_INFINITY
        case "asleep":
            time.sleep(999)
        case "hungry":
            return ColumnTable(columns={"x": np.ones(1 << 30)})
        case "abort":
            os.abort()
        case "talkative":
            os.write(1, b"what a library thinks of a file\n" * 9999)
            os.write(2, b"on both streams")
        case _:
            pass
    return ColumnTable(columns={key: np.arange(3.0) for key in wanted.users})


HERE = isolation.isolated(__name__)


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("endless", "reading it takes more than 1 s of the processor"),
        ("asleep", "reading it takes more than 2 s"),
        ("hungry", "reading it takes more than 500 MB of memory"),
        ("abort", "it ended its reader (SIGABRT)"),
    ],
)
def test_a_reader_has_limits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, reason: str
) -> None:
    monkeypatch.setattr(isolation, "_SECONDS", 1)
    # the endless one uses its second of the processor, wherever it has to share it
    monkeypatch.setattr(isolation, "_TIMES_SECONDS", 2 if name == "asleep" else 999)
    (tmp_path / name).write_bytes(b"")
    with pytest.raises(SpecError, match="E0802") as caught:
        HERE(tmp_path / name, name, WANTED, Dialect())
    assert reason in caught.value.diagnostics[0].message


def test_a_library_is_loaded_without_the_limits_of_the_file_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its import needs memory that no small file may take."""
    monkeypatch.setattr(isolation, "_MEMORY", 1 << 20)
    isolation.end_readers()
    (tmp_path / "library").write_bytes(b"")
    assert HERE(tmp_path / "library", "library", WANTED, Dialect()) is not None
    monkeypatch.setattr(isolation, "_MEMORY", 1 << 29)
    write_mdf(tmp_path / "a.mf4")
    read_mdf = format_of("a.mf4").reader
    assert read_mdf(tmp_path / "a.mf4", "a.mf4", WANTED, Dialect()) is not None


def test_what_a_reader_prints_is_no_answer(tmp_path: Path) -> None:
    (tmp_path / "talkative").write_bytes(b"")
    found = HERE(tmp_path / "talkative", "talkative", WANTED, Dialect())
    assert isinstance(found, ColumnTable)
    assert [values.tolist() for values in found.columns.values()] == [[0, 1, 2], [0, 1, 2]]


def test_the_process_that_reads_runs_no_module_of_the_working_folder(tmp_path: Path) -> None:
    import h5py

    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["x"], file["F"] = TIME, TIME
    for name in ("h5py", "numpy", "asammdf", "sitecustomize", "resource"):
        (tmp_path / f"{name}.py").write_text(f"open('ran {name}', 'w').close()\n")
    program = (
        "import sys; from pathlib import Path\n"
        "from msnn.data.formats.table_of_formats import format_of\n"
        "from msnn.data.formats.table import WantedColumns\n"
        "from msnn.data.formats.text.csv_header import Dialect\n"
        # as `python -m` has it, once this process has imported its own
        "sys.path.insert(0, ''); sys.path.insert(0, str(Path.cwd()))\n"
        "wanted = WantedColumns({'x': 'x'})\n"
        "found = format_of('a.h5').reader(Path('a.h5'), 'a.h5', wanted, Dialect())\n"
        "print(len(found.columns['x']))\n"
    )
    environment = {**os.environ, "PYTHONPATH": "", "PYTHONSAFEPATH": "1"}
    ran = subprocess.run(
        [sys.executable, "-c", program],
        check=False,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        env=environment,
    )
    assert (ran.stdout, ran.stderr) == ("60\n", "")
    assert not list(tmp_path.glob("ran *"))


def test_an_archive_that_unpacks_to_far_more_is_not_unpacked(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        for name in ("x", "F"):
            with archive.open(f"{name}.npy", "w") as member:
                header = {"descr": "<f8", "fortran_order": False, "shape": (37_500_000,)}
                np.lib.format.write_array_header_1_0(member, header)
                for _ in range(300):
                    member.write(bytes(1_000_000))
    assert "a.npz: it unpacks to 300 MB" in fault(tmp_path, "a.npz").message
    rows = arrow.table({"x": np.zeros(5_000_000), "F": np.zeros(5_000_000)})
    with parquet.ParquetWriter(tmp_path / "a.parquet", rows.schema) as writer:
        for _ in range(8):
            writer.write_table(rows)
    assert "a.parquet: it unpacks to 640 MB" in fault(tmp_path, "a.parquet").message
    # 48 MB of numbers that do not change
    np.savez_compressed(tmp_path / "b.npz", x=np.zeros(3_000_000), F=np.zeros(3_000_000))
    assert load(tmp_path, "source: {train: b.npz}\n").rows == 3_000_000


def test_a_workbook_that_unpacks_to_far_more_is_not_unpacked(tmp_path: Path) -> None:
    book = openpyxl.Workbook()
    book.worksheets[0].append(["x", "F"])
    book.save(tmp_path / "a.xlsx")
    with (
        zipfile.ZipFile(tmp_path / "a.xlsx", "a", zipfile.ZIP_DEFLATED) as archive,
        archive.open("xl/sharedStrings2.xml", "w") as member,
    ):
        for _ in range(100):
            member.write(b"<si><t>a</t></si>" * 60_000)
    assert "a.xlsx: it unpacks to 102 MB" in fault(tmp_path, "a.xlsx").message


def test_a_cell_far_from_the_others_is_refused(tmp_path: Path) -> None:
    book = openpyxl.Workbook()
    book.worksheets[0].cell(1_048_576, 16_384, 1)
    book.save(tmp_path / "a.xlsx")
    said = fault(tmp_path, "a.xlsx")
    assert "row 1048576 has a cell in column 16384, far from the others" in said.message


@pytest.mark.parametrize("line", [1, 2, 4])
@pytest.mark.parametrize("text", ["1,", "u", '"'])
def test_a_line_that_is_no_row_is_refused(tmp_path: Path, line: int, text: str) -> None:
    lines = ["x,F", "1,2", "3,4", "5,6", "7,8"]
    lines[line - 1] = text * (LONGEST_LINE + 1)
    (tmp_path / "a.csv").write_text("\n".join(lines))
    said = fault(tmp_path, "a.csv")
    assert f"its line {line} has" in said.message


def test_a_long_cell_in_quotes_is_a_cell(tmp_path: Path) -> None:
    """The module `csv` takes 131,072 letters, and ends with an error of its own beyond."""
    text = 'x,F,note\n1,2,"' + "a" * 200_000 + '"\n3,4,b\n'
    data = load(tmp_path, "source: {train: a.csv}\n", {"a.csv": text})
    assert data.series["x"].tolist() == [1, 3]


def write_one_column(path: Path, cells: list[str]) -> None:
    if path.suffix == ".csv":
        path.write_text("\n".join(cells) + "\n")
        return
    book = openpyxl.Workbook()
    for row, cell in enumerate(cells, start=1):
        if cell:
            book.worksheets[0].cell(row, 1, cell if row == 1 else float(cell))
    book.save(path)


@pytest.mark.parametrize("name", ["a.csv", "a.xlsx"])
def test_a_blank_line_of_a_lone_column_is_a_missing_value(tmp_path: Path, name: str) -> None:
    write_one_column(tmp_path / name, ["x", "1", "", "3", "4", "", "", "7", "", ""])
    section = f"source: {{train: {name}}}\ncolumns: {{x: x, F: x}}\n"
    with pytest.raises(SpecError, match="E0809") as caught:
        load(tmp_path, section)
    (said,) = caught.value.diagnostics
    assert "has no value in row 1" in said.message
    assert said.notes == ("2 more cells of this kind in the file",)
    assert (said.span and said.span.line) == 3
    data = load(tmp_path, section + "nan: split\n")
    assert data.episodes("train").tolist() == [[0, 1], [2, 4], [6, 7]]


def test_blank_lines_of_a_wider_table_are_passed_over(tmp_path: Path) -> None:
    text = "\nx,F\n\n1,2\n\n3,4\n"
    data = load(tmp_path, "source: {train: a.csv}\n", {"a.csv": text})
    assert data.series["x"].tolist() == [1, 3]

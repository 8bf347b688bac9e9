"""Every format gives the same series for the same record, and says what is wrong with bad files."""

from __future__ import annotations

import logging
from collections.abc import Callable
from decimal import Decimal
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as arrow
import pyarrow.parquet as parquet
import pytest
from asammdf import MDF, Signal
from nptdms import ChannelObject, TdmsWriter
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.rosbag2.enums import StoragePlugin
from rosbags.typesys import Stores, get_typestore
from scipy.io import savemat

from msnn.data.formats.table_of_formats import FORMATS, FileFormat, format_of, require_reader
from msnn.errors.failures import MissingExtraError
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.diagnostics.render import render
from tests.data.specs import load

TIME = 0.2 * np.arange(12)
X = np.sin(TIME)
FORCE = np.cos(TIME)
ROWS = (TIME.tolist(), X.tolist(), FORCE.tolist())


def write_tsv(path: Path) -> None:
    rows = [f"{t!r}\t{x!r}\t{f!r}" for t, x, f in zip(*ROWS, strict=True)]
    path.write_text("\n".join(["time\tx\tF", *rows]) + "\n")


def write_npz(path: Path) -> None:
    np.savez(path, time=TIME, x=X, F=FORCE)


def write_parquet(path: Path) -> None:
    parquet.write_table(arrow.table({"time": TIME, "x": X, "F": FORCE}), path)


def write_mat(path: Path) -> None:
    savemat(path, {"time": TIME, "x": X[:, None], "F": FORCE[None, :]})


def write_hdf5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["time"], file["x"], file["F"] = TIME, X, FORCE


def write_mdf(path: Path) -> None:
    with MDF(version="4.10") as file:
        file.append([Signal(X, TIME, name="x"), Signal(FORCE, TIME, name="F")])
        file.save(path, overwrite=True)


def write_tdms(path: Path) -> None:
    with TdmsWriter(path) as writer:
        columns = {"time": TIME, "x": X, "F": FORCE}
        writer.write_segment(
            [ChannelObject("Run", name, values) for name, values in columns.items()]
        )


def write_ros1(path: Path) -> None:
    types = get_typestore(Stores.ROS1_NOETIC)
    vector = types.types["geometry_msgs/msg/Vector3"]
    with Ros1Writer(path) as bag:
        connection = bag.add_connection("/motion", vector.__msgtype__, typestore=types)
        for t, x, force in zip(TIME, X, FORCE, strict=True):
            raw = types.serialize_ros1(vector(x=x, y=force, z=0.0), vector.__msgtype__)
            bag.write(connection, int(5e9 + round(t * 1e9)), raw)


def write_ros2(path: Path, plugin: StoragePlugin) -> None:
    types = get_typestore(Stores.LATEST)
    vector = types.types["geometry_msgs/msg/Vector3"]
    with Ros2Writer(path, version=9, storage_plugin=plugin) as bag:
        connection = bag.add_connection("/motion", vector.__msgtype__, typestore=types)
        for t, x, force in zip(TIME, X, FORCE, strict=True):
            raw = types.serialize_cdr(vector(x=x, y=force, z=0.0), vector.__msgtype__)
            bag.write(connection, int(5e9 + round(t * 1e9)), raw)


WRITERS: dict[str, Callable[[Path], None]] = {
    "a.tsv": write_tsv,
    "a.npz": write_npz,
    "a.parquet": write_parquet,
    "a.mat": write_mat,
    "a.h5": write_hdf5,
    "a.mf4": write_mdf,
    "a.tdms": write_tdms,
}


def test_every_format_has_a_sample_record() -> None:
    # messages of ROS bags are tested below, workbooks in test_loggers_files.py, topics of ULog
    # files in test_ulog_files.py
    written = {format_of(name).name for name in (*WRITERS, "a.bag", "a.xlsx", "a.ulg")}
    for format in FORMATS:
        assert format.name in written, f"write the record as {format.name} in {__file__}"


@pytest.mark.parametrize("name", WRITERS)
def test_a_record_is_the_same_in_every_format(tmp_path: Path, name: str) -> None:
    WRITERS[name](tmp_path / name)
    data = load(tmp_path, f"source: {{train: {name}}}\ntime: time\n")
    np.testing.assert_array_equal(data.series["x"], X)
    np.testing.assert_array_equal(data.series["F"], FORCE)
    assert data.episodes("train").tolist() == [[0, 12]]


@pytest.mark.parametrize("kind", ["ros1", "db3", "mcap"])
def test_fields_of_messages_are_columns(tmp_path: Path, kind: str) -> None:
    match kind:
        case "ros1":
            name = "a.bag"
            write_ros1(tmp_path / name)
        case "db3":
            name = "run/run.db3"
            write_ros2(tmp_path / "run", StoragePlugin.SQLITE3)
        case _:
            name = "run/run.mcap"
            write_ros2(tmp_path / "run", StoragePlugin.MCAP)
    section = f"source: {{train: {name}}}\ncolumns: {{x: /motion.x, F: /motion.y}}\n"
    data = load(tmp_path, section)
    np.testing.assert_array_equal(data.series["x"], X)
    np.testing.assert_array_equal(data.series["F"], FORCE)
    assert data.episodes("train").tolist() == [[0, 12]]
    with pytest.raises(SpecError, match="E0804"):
        load(tmp_path, f"source: {{train: {name}}}\n")
    with pytest.raises(SpecError, match="no such field"):
        load(tmp_path, f"source: {{train: {name}}}\ncolumns: {{x: /motion.w, F: /motion.y}}\n")


def test_a_folder_stands_for_the_data_files_in_it(tmp_path: Path) -> None:
    (tmp_path / "runs").mkdir()
    write_npz(tmp_path / "runs" / "a.npz")
    write_tsv(tmp_path / "runs" / "b.tsv")
    (tmp_path / "runs" / "notes.md").write_text("not data")
    data = load(tmp_path, "source: {train: runs}\ntime: time\n")
    assert [record.file for record in data.records] == ["runs/a.npz", "runs/b.tsv"]


def test_columns_of_matrices_and_fields_of_structs_have_names(tmp_path: Path) -> None:
    both = np.stack((X, FORCE), axis=1)
    savemat(tmp_path / "a.mat", {"log": {"motion": both, "drive": {"force": FORCE}}})
    section = "source: {train: a.mat}\ncolumns: {x: 'log.motion[0]', F: log.drive.force}\n"
    np.testing.assert_array_equal(load(tmp_path, section).series["x"], X)
    np.testing.assert_array_equal(load(tmp_path, section).series["F"], FORCE)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["run/both"] = both
    section = "source: {train: a.h5}\ncolumns: {x: 'run/both[0]', F: 'run/both[1]'}\n"
    np.testing.assert_array_equal(load(tmp_path, section).series["F"], FORCE)


def test_matlab_7_3_keeps_matrices_by_column(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.mat", "w", userblock_size=512) as file:
        file["log/both"] = np.stack((X, FORCE))
    section = "source: {train: a.mat}\ncolumns: {x: 'log.both[0]', F: 'log.both[1]'}\n"
    data = load(tmp_path, section)
    np.testing.assert_array_equal(data.series["x"], X)
    np.testing.assert_array_equal(data.series["F"], FORCE)


def test_times_of_day_become_seconds(tmp_path: Path) -> None:
    moments = np.datetime64("2026-01-01T12:00:00") + (TIME * 1e9).astype("timedelta64[ns]")
    table = arrow.table({"time": moments, "x": X, "F": FORCE})
    parquet.write_table(table, tmp_path / "a.parquet")
    data = load(tmp_path, "source: {train: a.parquet}\ntime: time\nfrom: 0.4 s\n")
    np.testing.assert_array_equal(data.series["x"], X[2:])


@pytest.mark.parametrize(
    "force",
    [
        arrow.array([1, None, 3], arrow.int32()),
        arrow.array([True, None, False]),
        arrow.array([1.5, None, 3.0]),
        arrow.array([Decimal("1.5"), None, Decimal("3.0")]),
    ],
    ids=lambda force: str(force.type),
)
def test_null_is_a_missing_value(tmp_path: Path, force: Any) -> None:
    parquet.write_table(arrow.table({"x": [1.0, 2.0, 3.0], "F": force}), tmp_path / "a.parquet")
    data = load(tmp_path, "source: {train: a.parquet}\nnan: split\n")
    assert data.episodes("train").tolist() == [[0, 1], [2, 3]]
    with pytest.raises(SpecError, match="E0809"):
        load(tmp_path, "source: {train: a.parquet}\n")


def test_a_channel_of_several_groups_is_chosen_by_its_group(tmp_path: Path) -> None:
    with MDF(version="4.10") as file:
        file.append([Signal(X, TIME, name="x"), Signal(FORCE, TIME, name="F")])
        file.append([Signal(-X, TIME, name="x")])
        file.save(tmp_path / "a.mf4", overwrite=True)
    with pytest.raises(SpecError, match=r"two columns `x`") as error:
        load(tmp_path, "source: {train: a.mf4}\n")
    assert error.value.diagnostics[0].help == "choose one of `x@0`, `x@1`"
    data = load(tmp_path, "source: {train: a.mf4}\ncolumns: {x: x@1}\n")
    np.testing.assert_array_equal(data.series["x"], -X)


@pytest.mark.parametrize("name", [f"a{f.suffixes[0]}" for f in FORMATS if not f.is_text])
def test_a_broken_file_is_said_to_be_unreadable(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"not what it says it is" * 99)
    with pytest.raises(SpecError, match="E0802") as error:
        load(tmp_path, f"source: {{train: {name}}}\n")
    assert name in error.value.diagnostics[0].message


@pytest.mark.parametrize("name", ["a.npz", "a.parquet", "a.mat", "a.h5"])
def test_a_cut_off_file_is_said_to_be_unreadable(tmp_path: Path, name: str) -> None:
    WRITERS[name](tmp_path / name)
    whole = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(whole[: len(whole) // 2])
    with pytest.raises(SpecError, match="E0802"):
        load(tmp_path, f"source: {{train: {name}}}\n")


def test_pickled_objects_are_refused(tmp_path: Path) -> None:
    """numpy advises to run what the file says (`allow_pickle`); msnn does not hand that on."""
    np.savez(tmp_path / "a.npz", x=np.array([{"a": 1}], dtype=object), F=FORCE)
    with pytest.raises(SpecError, match="E0802") as error:
        load(tmp_path, "source: {train: a.npz}\n")
    assert "`x` holds Python objects, not numbers" in str(error.value)
    assert "pickle" not in str(error.value)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"\x80\x04\x95 a pickle", "it is no archive of numpy.savez"),
        (b"\x93NUMPY\x01\x00", "it is a lone array"),
        (b"", "it is no archive of numpy.savez"),
    ],
)
def test_what_is_no_archive_of_arrays_says_so(tmp_path: Path, content: bytes, reason: str) -> None:
    (tmp_path / "a.npz").write_bytes(content)
    with pytest.raises(SpecError, match="E0802") as error:
        load(tmp_path, "source: {train: a.npz}\n")
    assert reason in str(error.value)
    assert "pickle" not in str(error.value)


@pytest.mark.parametrize("name", ["a.csv", "a.npz", "a.parquet"])
def test_a_long_name_of_a_column_is_cut_in_a_message(tmp_path: Path, name: str) -> None:
    """A file without line ends is one name of megabytes."""
    long = "x" * 100_000
    if name == "a.csv":
        (tmp_path / name).write_text(f"{long}\n1\n")
    elif name == "a.npz":
        np.savez(tmp_path / name, **{long[:40_000]: X})  # pyright: ignore[reportArgumentType]
    else:
        parquet.write_table(arrow.table({long: X}), tmp_path / name)
    with pytest.raises(SpecError, match="E0804") as error:
        load(tmp_path, f"source: {{train: {name}}}\n")
    (found,) = error.value.diagnostics
    assert len(render([found], "full")) < 500
    assert "0,000 characters)" in found.notes[0]


def test_the_reader_of_mdf_prints_no_lines_of_its_own(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    write_mdf(tmp_path / "a.mf4")
    load(tmp_path, "source: {train: a.mf4}\n")
    logging.getLogger("asammdf").error("a line that no command prints")
    assert "a line" not in "".join(capfd.readouterr())


def test_numbers_kept_in_another_file_are_not_read(tmp_path: Path) -> None:
    (tmp_path / "secret.bin").write_bytes(X.tobytes())
    write_hdf5(tmp_path / "other.h5")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["F"] = FORCE
        outside = [(str(tmp_path / "secret.bin"), 0, X.nbytes)]
        file.create_dataset("x", shape=X.shape, dtype=X.dtype, external=outside)
    with pytest.raises(SpecError, match="no column `x`"):
        load(tmp_path, "source: {train: a.h5}\n")
    with h5py.File(tmp_path / "b.h5", "w") as file:
        file["F"], file["x"] = FORCE, h5py.ExternalLink("other.h5", "/x")
    with pytest.raises(SpecError, match="no column `x`"):
        load(tmp_path, "source: {train: b.h5}\n")


@pytest.mark.parametrize(
    ("arrays", "code", "words"),
    [
        ({"x": X}, "E0804", "no column `F`"),
        ({"x": X, "F": FORCE[:5]}, "E0841", "not equally long"),
        ({"x": X.astype(complex), "F": FORCE}, "E0840", "real numbers"),
        ({"x": np.array(["a"] * 12), "F": FORCE}, "E0840", "real numbers"),
        ({"x": np.ones((12, 3)), "F": FORCE}, "E0840", "3 columns"),
        ({"x": np.ones((2, 3, 4)), "F": FORCE}, "E0840", "no column"),
        ({"x": np.where(TIME > 1, np.inf, X), "F": FORCE}, "E0810", "not finite"),
        ({"x": np.zeros(0), "F": np.zeros(0)}, "E0803", "no data rows"),
    ],
)
def test_arrays_that_are_no_columns(
    tmp_path: Path, arrays: dict[str, np.ndarray], code: str, words: str
) -> None:
    np.savez(tmp_path / "a.npz", **arrays)  # pyright: ignore[reportArgumentType]
    with pytest.raises(SpecError, match=code) as error:
        load(tmp_path, "source: {train: a.npz}\n")
    assert words in str(error.value)


def test_a_format_without_its_reader_names_the_install_line(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(FileFormat, "missing", property(lambda format: format.packages))
    require_reader("a.csv")
    for format in FORMATS:
        if format.packages:
            with pytest.raises(MissingExtraError) as error:
                require_reader(f"runs/a{format.suffixes[0]}")
            assert error.value.diagnostic.help == format.packages[0].install


def test_a_suffix_that_says_nothing_is_text() -> None:
    assert format_of("a.log").name == "CSV"
    assert format_of("A.PARQUET").name == "Parquet"

"""Reads spoiled copies of files of every format, and says what became of each.

`python -m benchmarks.fuzz.spoiled_files [--count 2000] [--first SEED] [--findings FOLDER]`. Copies
of a whole file have flipped bits, lost ends, and blocks that are exchanged, repeated or zero. All
formats are read by the process of compiled readers. A copy is a finding if it ends that process,
takes more than 5 s of the processor or 500 MB, is refused without a message, or if it gives fewer
rows or, in a format with checksums, other values without a warning. Linux only: time and memory are
those of `/proc`.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import tempfile
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import h5py
import numpy as np
import openpyxl
import pandas as pd
import scipy.io
from asammdf import MDF, Signal
from nptdms import ChannelObject, TdmsWriter
from numpy.typing import NDArray
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_typestore

from msnn.data.dataset import FloatArray
from msnn.data.formats.isolation import reader as isolation
from msnn.data.formats.table import ColumnTable, Streams, WantedColumns
from msnn.data.formats.table_of_formats import format_of
from msnn.data.formats.text.csv_header import Dialect
from spec_schema.diagnostics.diagnostic import SpecError
from tests.data import ulog_files as ulog

_frame: Any = pd.DataFrame
# scipy, numpy and h5py leave types open
_savemat: Any = vars(scipy.io)["savemat"]
_savez: Any = np.savez_compressed
ROWS = 200
SECONDS, MEMORY = 5.0, 500_000_000
"""Limits per file, beyond the time and the memory of the whole file."""
_HANGS = 120
"""Seconds after which a reader that takes no time of the processor is ended."""

Values: TypeAlias = NDArray[np.float64]
Read: TypeAlias = Mapping[str, tuple[Values, Values] | Values]


def columns() -> dict[str, Values]:
    time: Values = 0.2 * np.arange(ROWS, dtype=np.float64)
    return {"x": np.sin(time), "F": time * time}


def _write_csv(path: Path, columns: Mapping[str, Values]) -> None:
    _frame(columns).to_csv(path, index=False)


def _write_xlsx(path: Path, columns: Mapping[str, Values]) -> None:
    book = openpyxl.Workbook()
    sheet = book.active
    assert sheet is not None
    for row in (tuple(columns), *zip(*columns.values(), strict=True)):
        sheet.append([cell if isinstance(cell, str) else float(cell) for cell in row])
    book.save(path)


def _write_hdf5(path: Path, columns: Mapping[str, Values]) -> None:
    file: Any
    with h5py.File(path, "w", userblock_size=512 if path.suffix == ".mat" else 0) as file:
        for name, values in columns.items():
            file.create_dataset(name, data=values, compression="gzip", fletcher32=True)
    if path.suffix == ".mat":
        # MATLAB 7.3 writes its own header before that of HDF5
        with path.open("r+b") as file:
            begin = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
            file.write(begin)


def _write_mdf(path: Path, columns: Mapping[str, Values]) -> None:
    time = 0.2 * np.arange(ROWS)
    with MDF(version="4.10") as file:
        file.append([Signal(values, time, name=name) for name, values in columns.items()])
        file.save(path, overwrite=True, compression=2 if path.stem == "packed" else 0)


def _write_bag(path: Path, columns: Mapping[str, Values]) -> None:
    is_ros1 = path.suffix == ".bag"
    types = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.LATEST)
    kind: Any = types.types["geometry_msgs/msg/Vector3"]
    serialize = types.serialize_ros1 if is_ros1 else types.serialize_cdr
    plugin = StoragePlugin.MCAP if path.suffix == ".mcap" else StoragePlugin.SQLITE3
    folder = path if is_ros1 else path.with_name(f"{path.stem}_{path.suffix[1:]}")
    with (
        Ros1Writer(path) if is_ros1 else Ros2Writer(folder, version=9, storage_plugin=plugin) as bag
    ):
        connection = bag.add_connection("/motion", kind.__msgtype__, typestore=types)
        for i, (x, force) in enumerate(zip(*columns.values(), strict=True)):
            raw = serialize(kind(x=x, y=force, z=0.0), kind.__msgtype__)
            bag.write(connection, 5 * 10**9 + i * 200_000_000, raw)
    if not is_ros1:
        (written,) = folder.glob(f"*{path.suffix}")
        shutil.copy(written, path)


def _write_tdms(path: Path, columns: Mapping[str, Values]) -> None:
    channels = [
        ChannelObject("Run", name, values, {"wf_increment": 0.2})
        for name, values in columns.items()
    ]
    writer: Any
    with TdmsWriter(path) as writer:
        writer.write_segment(channels)


def _write_ulog(path: Path, columns: Mapping[str, Values]) -> None:
    begin = (
        ulog.header()
        + ulog.flags()
        + ulog.topic_format("m", "uint64_t timestamp;double x;double F;")
    )
    rows = enumerate(zip(*(values.tolist() for values in columns.values()), strict=True))
    steps = [ulog.data(0, "Qdd", ulog.START + 200_000 * i, x, force) for i, (x, force) in rows]
    path.write_bytes(begin + ulog.subscription(0, "m") + b"".join(steps))


@dataclass(frozen=True)
class Kind:
    """A file to spoil."""

    name: str
    write: Callable[[Path, Mapping[str, Values]], None]
    keys: tuple[str, str] = ("x", "F")
    has_checksums: bool = False
    """True if a checksum covers its values."""
    has_count: bool = True
    """True if the file states how many rows it has."""


KINDS = (
    Kind("a.csv", _write_csv, has_count=False),
    Kind("a.xlsx", _write_xlsx, has_checksums=True),
    Kind("a.npz", lambda path, columns: _savez(path, **columns), has_checksums=True),
    Kind("a.parquet", lambda path, columns: _frame(columns).to_parquet(path)),
    Kind(
        "sums.parquet",
        lambda path, columns: _frame(columns).to_parquet(path, write_page_checksum=True),
        has_checksums=True,
    ),
    Kind(
        "a.mat",
        lambda path, columns: _savemat(path, dict(columns), do_compression=True),
        has_checksums=True,
    ),
    Kind("plain.mat", lambda path, columns: _savemat(path, dict(columns))),
    Kind("new.mat", _write_hdf5, has_checksums=True),
    Kind("a.h5", _write_hdf5, has_checksums=True),
    Kind("a.mf4", _write_mdf),
    Kind("packed.mf4", _write_mdf, has_checksums=True),
    Kind("a.bag", _write_bag, ("/motion.x", "/motion.y")),
    Kind("a.db3", _write_bag, ("/motion.x", "/motion.y")),
    # rosbags writes no checksums
    Kind("a.mcap", _write_bag, ("/motion.x", "/motion.y")),
    Kind("a.tdms", _write_tdms),
    Kind("a.ulg", _write_ulog, ("m.x", "m.F"), has_count=False),
)


def spoiled(whole: bytes, seed: int) -> bytes:
    """A copy with one kind of damage, which depends on the seed alone."""
    rng = random.Random(seed)  # noqa: S311 - copies that are the same each time
    found = bytearray(whole)
    # the beginning has what a reader believes
    near = len(found) if rng.random() < 0.6 else min(len(found), 600)
    match rng.choice(("bits", "bits", "bytes", "end", "exchange", "repeat", "zero")):
        case "bits":
            for _ in range(rng.choice((1, 1, 3, 20))):
                found[rng.randrange(near)] ^= 1 << rng.randrange(8)
        case "bytes":
            for _ in range(rng.choice((1, 4, 16))):
                found[rng.randrange(near)] = rng.choice((0, 1, 127, 128, 255, rng.randrange(256)))
        case "end":
            del found[rng.randrange(len(found)) :]
        case "exchange":
            size = rng.choice((4, 8, 64, 512))
            one, other = (rng.randrange(max(near - size, 1)) for _ in range(2))
            block = found[one : one + size]
            found[one : one + size] = found[other : other + size]
            found[other : other + size] = block
        case "repeat":
            size = rng.choice((4, 8, 64, 512))
            at = rng.randrange(near)
            found[at:at] = found[at : at + size]
        case _:
            at = rng.randrange(near)
            size = min(rng.choice((4, 64, 512)), len(found) - at)
            found[at : at + size] = bytes(size)
    return bytes(found)


@dataclass(frozen=True)
class Outcome:
    """The result of one file."""

    what: str
    """whole, other values, fewer rows, warned, or the code of an error."""
    text: str = ""
    seconds: float = 0.0
    memory: int = 0
    """Bytes beyond those that the process had."""
    table: ColumnTable | Streams | None = None


def read(path: Path, kind: Kind, whole: ColumnTable | Streams | None = None) -> Outcome:
    """Reads a file as the command does, in the process of compiled readers."""
    wanted = WantedColumns({key: f"`{key}`" for key in kind.keys}, frozenset(kind.keys))
    readers: Any = isolation._readers(os.getpid())
    readers._process = process = readers._process or isolation._started()
    seconds, memory = _used(process.pid)
    signal.signal(signal.SIGALRM, lambda number, frame: process.kill())
    signal.alarm(_HANGS)
    table, what, text = None, "", ""
    try:
        table = isolation.isolated(format_of(path).module)(path, path.name, wanted, Dialect())
    except SpecError as error:
        fault = error.diagnostics[0]
        what, text = fault.code, fault.message
    # that is a finding
    except Exception as error:  # noqa: BLE001
        what, text = "exception", repr(error)
    signal.alarm(0)
    if process.poll() is not None:
        return Outcome("hang" if process.returncode == -signal.SIGKILL else "end", text)
    after, most = _used(process.pid)
    if table is not None:
        what = "whole" if whole is None else _compared(table, whole)
    return Outcome(what, text, after - seconds, max(most - memory, 0), table)


def _used(process: int) -> tuple[float, int]:
    """Seconds of the processor that a process has used, and the most memory since the last call."""
    folder = Path(f"/proc/{process}")
    fields = (folder / "stat").read_text().rpartition(")")[2].split()
    status = dict(line.split(":", 1) for line in (folder / "status").read_text().splitlines())
    (folder / "clear_refs").write_text("5")
    ticks = int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK"), 1024 * int(status["VmHWM"].split()[0])


def _compared(found: ColumnTable | Streams, whole: ColumnTable | Streams) -> str:
    if type(found) is not type(whole):
        # without the description of its times
        return "warned" if found.warnings else "other values"
    pairs = list(zip(_series(found), _series(whole), strict=True))
    if all(np.array_equal(a, b, equal_nan=True) for a, b in pairs):
        return "whole"
    if found.warnings:
        return "warned"
    return "other rows" if any(len(a) != len(b) for a, b in pairs) else "other values"


def _series(table: ColumnTable | Streams) -> list[FloatArray]:
    if isinstance(table, Streams):
        return [array for pair in table.columns.values() for array in pair]
    return list(table.columns.values())


def is_finding(outcome: Outcome, kind: Kind, usual: Outcome) -> bool:
    """True if msnn should have said something else, or earlier."""
    if outcome.what in ("end", "hang", "exception"):
        return outcome.what != "end" or not format_of(kind.name).is_isolated
    if outcome.seconds > usual.seconds + SECONDS or outcome.memory > usual.memory + MEMORY:
        return True
    return (outcome.what == "other rows" and kind.has_count) or (
        outcome.what == "other values" and kind.has_checksums
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--findings", type=Path)
    arguments = parser.parse_args()
    counts: dict[str, Counter[str]] = {kind.name: Counter() for kind in KINDS}
    most: dict[str, list[float]] = {kind.name: [0.0, 0.0] for kind in KINDS}
    findings = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        wholes: dict[str, Outcome] = {}
        for kind in KINDS:
            kind.write(folder / kind.name, columns())
            # twice: the first also loads modules
            for _ in range(2):
                wholes[kind.name] = read(folder / kind.name, kind)
            assert wholes[kind.name].table is not None, (kind.name, wholes[kind.name])
        for seed in range(arguments.first, arguments.first + arguments.count):
            kind = KINDS[seed % len(KINDS)]
            whole = wholes[kind.name]
            path = folder / f"spoiled{Path(kind.name).suffix}"
            path.write_bytes(spoiled((folder / kind.name).read_bytes(), seed))
            outcome = read(path, kind, whole.table)
            counts[kind.name][outcome.what] += 1
            used = most[kind.name]
            used[0], used[1] = max(used[0], outcome.seconds), max(used[1], outcome.memory)
            if not is_finding(outcome, kind, whole):
                continue
            findings += 1
            print(f"seed {seed}, {kind.name}: {outcome.what} {outcome.text}", flush=True)
            print(f"  {outcome.seconds:.2f} s, {outcome.memory / 1e6:.0f} MB", flush=True)
            if arguments.findings is not None:
                arguments.findings.mkdir(parents=True, exist_ok=True)
                shutil.copy(path, arguments.findings / f"seed_{seed}{path.suffix}")
    for name, found in counts.items():
        parts = ", ".join(f"{what} {count}" for what, count in found.most_common())
        print(f"{name}: {parts}; at most {most[name][0]:.2f} s, {most[name][1] / 1e6:.0f} MB")
    print(f"{arguments.count} files, {findings} findings")


if __name__ == "__main__":
    main()

"""Spoiled copies of a file of each format give its values, a message, or a warning."""

from __future__ import annotations

import sqlite3
import struct
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as arrow
import pyarrow.parquet as parquet
import pytest

from benchmarks.fuzz import spoiled_files as fuzz

SEEDS = 12


@pytest.mark.parametrize("kind", fuzz.KINDS, ids=[kind.name for kind in fuzz.KINDS])
def test_no_spoiled_copy_is_read_silently(tmp_path: Path, kind: fuzz.Kind) -> None:
    kind.write(tmp_path / kind.name, fuzz.columns())
    whole = [fuzz.read(tmp_path / kind.name, kind) for _ in range(2)][-1]
    path = tmp_path / f"spoiled{Path(kind.name).suffix}"
    seen: set[str] = set()
    for seed in range(SEEDS):
        path.write_bytes(fuzz.spoiled((tmp_path / kind.name).read_bytes(), seed))
        outcome = fuzz.read(path, kind, whole.table)
        assert not fuzz.is_finding(outcome, kind, whole), (seed, outcome.what, outcome.text)
        seen.add(outcome.what)
    assert "E0802" in seen


def test_a_copy_is_the_same_each_time() -> None:
    whole = bytes(range(256)) * 9
    copies = [fuzz.spoiled(whole, seed) for seed in range(40)]
    assert copies == [fuzz.spoiled(whole, seed) for seed in range(40)]
    assert len({*copies, whole}) > 30


def kind_of(name: str) -> fuzz.Kind:
    return next(kind for kind in fuzz.KINDS if kind.name == name)


def test_a_bag_without_some_of_its_messages_is_refused(tmp_path: Path) -> None:
    """rosbags passes over a message of another connection than its index says."""
    kind = kind_of("a.mcap")
    kind.write(tmp_path / "a.mcap", fuzz.columns())
    whole = bytearray((tmp_path / "a.mcap").read_bytes())
    # a message is its code (1 byte), length (8), channel (2), number (4) and time
    at = whole.index(struct.pack("<Q", 5 * 10**9 + 7 * 200_000_000)) - 15
    assert whole[at] == 5
    whole[at] = 0x7F
    (tmp_path / "a.mcap").write_bytes(whole)
    outcome = fuzz.read(tmp_path / "a.mcap", kind)
    assert outcome.what == "E0802"
    assert "it states 200 messages of these topics, and has 199" in outcome.text


def test_a_group_whose_data_end_early_is_read_with_a_warning(tmp_path: Path) -> None:
    kind = kind_of("a.mf4")
    kind.write(tmp_path / "a.mf4", fuzz.columns())
    whole = bytearray((tmp_path / "a.mf4").read_bytes())
    # the length of the block of data: its name (4 bytes), 4 of padding, and the length
    at = whole.index(b"##DT") + 8
    length = struct.unpack("<Q", whole[at : at + 8])[0]
    whole[at : at + 8] = struct.pack("<Q", length - 4 * 24)
    (tmp_path / "a.mf4").write_bytes(whole)
    outcome = fuzz.read(tmp_path / "a.mf4", kind)
    assert outcome.table is not None
    (warning,) = outcome.table.warnings
    assert warning.code == "W0838"
    assert "group 0 states 200 records, its data have 196" in warning.message


def test_a_bag_of_a_damaged_database_is_refused(tmp_path: Path) -> None:
    """SQLite passes over rows to which no page points any more."""
    kind = kind_of("a.db3")
    kind.write(tmp_path / "a.db3", fuzz.columns())
    whole = bytearray((tmp_path / "a.db3").read_bytes())
    with sqlite3.connect(tmp_path / "a.db3") as base:
        sql = "SELECT rootpage FROM sqlite_master WHERE name = 'messages'"
        ((page,),) = base.execute(sql).fetchall()
        ((size,),) = base.execute("PRAGMA page_size").fetchall()
    # the number of cells of the page at the root of the table
    at = (page - 1) * size + 3
    count = struct.unpack(">H", whole[at : at + 2])[0]
    whole[at : at + 2] = struct.pack(">H", count - 1)
    (tmp_path / "a.db3").write_bytes(whole)
    assert fuzz.read(tmp_path / "a.db3", kind).what == "E0802"


def test_checksums_of_parquet_pages_are_compared(tmp_path: Path) -> None:
    kind = kind_of("sums.parquet")
    columns = {"x": 7.25 + np.arange(200), "F": np.arange(200.0)}
    frame = pd.DataFrame(columns)
    table = arrow.Table.from_pandas(frame)
    parquet.write_table(
        table,
        tmp_path / "a.parquet",
        write_page_checksum=True,
        use_dictionary=False,
        compression="none",
    )
    whole = bytearray((tmp_path / "a.parquet").read_bytes())
    whole[whole.index(struct.pack("<2d", 17.25, 18.25))] ^= 1
    (tmp_path / "a.parquet").write_bytes(whole)
    outcome = fuzz.read(tmp_path / "a.parquet", kind)
    assert (outcome.what, "checksum" in outcome.text.lower()) == ("E0802", True)

"""Records at the end of a file are there whole or not at all."""

from __future__ import annotations

from pathlib import Path

import pytest

from backends.files.atomic_write import AppendedFile
from tests.full_disk import full_after


def test_a_record_that_a_full_disk_takes_in_part_is_taken_back(tmp_path: Path) -> None:
    path = tmp_path / "records"
    file = AppendedFile(path)
    with full_after(100):
        file.write(b"a" * 60)
        with pytest.raises(OSError, match="too large") as caught:
            file.write(b"b" * 60)
    assert caught.value.filename == str(path)
    assert path.read_bytes() == b"a" * 60
    file.write(b"c")  # somebody made room
    file.close()
    assert path.read_bytes() == b"a" * 60 + b"c"

"""Golden files: any difference in bytes fails, and accepting makes the file what was written."""

from pathlib import Path

import pytest

from tests.golden import assert_golden


def test_equal_text_passes(tmp_path: Path):
    (tmp_path / "model.c").write_bytes(b"a\nb\n")
    assert_golden(tmp_path / "model.c", "a\nb\n", accept=False)


@pytest.mark.parametrize("text", ["a\nc\n", "a\nb", "a\r\nb\n"])
def test_any_difference_fails(tmp_path: Path, text: str):
    (tmp_path / "model.c").write_bytes(b"a\nb\n")
    with pytest.raises(AssertionError, match=r"--accept writes model\.c"):
        assert_golden(tmp_path / "model.c", text, accept=False)


def test_a_missing_file_fails(tmp_path: Path):
    with pytest.raises(AssertionError, match="does not exist"):
        assert_golden(tmp_path / "model.c", "a\n", accept=False)


def test_accept_writes_the_text_byte_for_byte(tmp_path: Path):
    path = tmp_path / "new" / "model.c"
    assert_golden(path, "µ\r\n", accept=True)
    assert path.read_bytes() == "µ\r\n".encode()

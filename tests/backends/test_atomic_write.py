"""Files appear whole, and a writer that fails leaves the old file and nothing beside it."""

from pathlib import Path

import pytest

from backends.files.atomic_write import replacing, write_bytes, write_text


def test_writes_text_with_unix_line_ends_into_new_folders(tmp_path: Path):
    path = write_text(tmp_path / "a" / "b" / "model.txt", "τ = 1\nend\n")
    assert path.read_bytes() == "τ = 1\nend\n".encode()


def test_replaces_what_was_there(tmp_path: Path):
    path = tmp_path / "model.bin"
    write_bytes(path, b"old")
    write_bytes(path, b"new")
    assert path.read_bytes() == b"new"
    assert [p.name for p in tmp_path.iterdir()] == ["model.bin"]


def test_a_failing_writer_leaves_the_old_file(tmp_path: Path):
    path = tmp_path / "model.bin"
    write_bytes(path, b"old")
    with pytest.raises(OSError, match="disk full"):
        _write_half(path)
    assert path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["model.bin"]


def test_a_writer_that_writes_nothing_is_an_error(tmp_path: Path):
    with pytest.raises(FileNotFoundError), replacing(tmp_path / "model.bin"):
        pass


def _write_half(path: Path) -> None:
    with replacing(path) as temporary:
        temporary.write_bytes(b"half")
        raise OSError("disk full")


@pytest.mark.parametrize("name", [".", "folder"])
def test_a_folder_is_no_file_to_write(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    with pytest.raises(IsADirectoryError):
        write_text(Path(name), "text")
    assert [path.name for path in tmp_path.rglob("*")] == ["folder"]


def test_an_error_names_the_file_that_was_asked_for(tmp_path: Path) -> None:
    path = tmp_path / ("x" * 250)  # the temporary name is longer than the 255 bytes of a name
    with pytest.raises(OSError, match="name too long") as caught:
        write_text(path, "text")
    assert caught.value.filename == str(path)

"""Files appear whole, and a writer that fails leaves the old file and nothing beside it."""

import errno
import os
import signal
import stat
import threading
from pathlib import Path

import pytest

from backends.files.atomic_write import replacing, replacing_files, write_bytes, write_text


def waits_for_disk(patch: pytest.MonkeyPatch, path: Path) -> list[tuple[str, bytes]]:
    """What is waited for from now on, a file or a folder, and what the path holds at that moment.

    Of a file it is told whether it is empty: what is waited for too early is not on the disk.
    """
    found: list[tuple[str, bytes]] = []

    def noted(number: int) -> None:
        at = os.fstat(number)
        kind = "folder" if stat.S_ISDIR(at.st_mode) else "file" if at.st_size else "empty file"
        found.append((kind, path.read_bytes() if path.exists() else b""))

    patch.setattr(os, "fsync", noted)
    return found


def test_content_reaches_the_disk_before_its_name_and_the_name_before_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    path = write_bytes(tmp_path / "weights", b"old")
    found = waits_for_disk(monkeypatch, path)
    write_bytes(path, b"new", durable=True)
    assert found == [("file", b"old"), ("folder", b"new")]
    write_text(path, "newer", durable=True)
    assert found[2:] == [("file", b"new"), ("folder", b"newer")]
    write_bytes(path, b"later", durable=True, named_later=True)
    assert found[4:] == [("file", b"newer")]
    write_bytes(path, b"whenever")
    assert len(found) == 5


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


def test_files_appear_together_or_not_at_all(tmp_path: Path) -> None:
    folder = tmp_path / "build" / "c"
    with pytest.raises(OSError, match="disk full"):
        _write_some(folder, fail=True)
    assert not folder.exists()
    _write_some(folder, fail=False)
    assert _texts(folder) == {"model.c": "new", "inner/model.h": "new"}
    (folder / "model.c").write_text("old")
    (folder / "own.c").write_text("of the user")
    with pytest.raises(OSError, match="disk full"):
        _write_some(folder, fail=True)
    assert _texts(folder) == {"model.c": "old", "inner/model.h": "new", "own.c": "of the user"}
    _write_some(folder, fail=False)
    assert _texts(folder) == {"model.c": "new", "inner/model.h": "new", "own.c": "of the user"}
    assert [path.name for path in folder.parent.iterdir()] == ["c"]


def _write_some(folder: Path, *, fail: bool) -> None:
    with replacing_files(folder) as temporary:
        write_text(temporary / "model.c", "new")
        write_text(temporary / "inner" / "model.h", "new")
        if fail:
            raise OSError("disk full")


def _texts(folder: Path) -> dict[str, str]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_text() for path in files}


def test_an_error_in_one_of_several_files_names_it(tmp_path: Path) -> None:
    folder = tmp_path / "c"
    name = "x" * 250
    with pytest.raises(OSError, match="name too long") as caught, replacing_files(folder) as files:
        write_text(files / name, "text")
    assert caught.value.filename == str(folder / name)


def test_a_signal_waits_until_all_files_have_their_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "c"
    _write_some(folder, fail=False)
    (folder / "model.c").write_text("old")
    (folder / "inner" / "model.h").write_text("old")
    replace = Path.replace

    def interrupted(self: Path, target: Path) -> Path:
        if folder in target.parents:
            signal.raise_signal(signal.SIGINT)
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        _write_some(folder, fail=False)
    assert _texts(folder) == {"model.c": "new", "inner/model.h": "new"}


def test_a_full_disk_is_told_with_the_name_of_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(self: Path, data: bytes) -> int:
        del self, data
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OSError, match="No space left") as caught:
        write_text(tmp_path / "model.c", "text")
    assert caught.value.filename == str(tmp_path / "model.c")


def test_a_pipe_gets_the_bytes_and_stays_a_pipe(tmp_path: Path) -> None:
    """As a device does: `-o /dev/null` of root would else put a file in its place."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    found: list[bytes] = []
    # a daemon: it would wait for ever for bytes that went elsewhere
    reader = threading.Thread(target=lambda: found.append(pipe.read_bytes()), daemon=True)
    reader.start()
    write_text(pipe, "whole")
    reader.join(timeout=10)
    assert found == [b"whole"]
    assert pipe.is_fifo()
    assert [path.name for path in tmp_path.iterdir()] == ["pipe"]


def test_what_a_shell_has_opened_gets_the_bytes(tmp_path: Path) -> None:
    """`-o /dev/stdout > file`: what is printed later follows them."""
    with (tmp_path / "file").open("wb") as file:
        write_text(Path(f"/proc/self/fd/{file.fileno()}"), "whole")
        file.write(b", later")
    assert (tmp_path / "file").read_bytes() == b"whole, later"


def test_a_link_to_a_pipe_is_replaced(tmp_path: Path) -> None:
    """Whoever plants a link does not decide where bytes go."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to("pipe")
    write_text(tmp_path / "link", "new")
    assert not (tmp_path / "link").is_symlink()
    assert (tmp_path / "link").read_text() == "new"


@pytest.mark.parametrize("mask", [0o777, 0o400])
def test_a_file_that_its_owner_could_not_read_is_refused(tmp_path: Path, mask: int) -> None:
    """Root could go on for hours, and leave a run that nobody else can read."""
    (tmp_path / "old").write_text("as before")
    before = os.umask(mask)
    try:
        with pytest.raises(OSError, match="the umask would leave a file") as caught:
            write_text(tmp_path / "old", "new")
        assert caught.value.filename == str(tmp_path / "old")
        with (
            pytest.raises(OSError, match=r"umask|denied"),
            replacing_files(tmp_path / "folder") as temporary,
        ):
            (temporary / "a").write_text("a")
    finally:
        os.umask(before)
    assert (tmp_path / "old").read_text() == "as before"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["old"]


@pytest.mark.parametrize("mask", [0o077, 0o222])
def test_a_file_for_its_owner_alone_is_fine(tmp_path: Path, mask: int) -> None:
    before = os.umask(mask)
    try:
        assert write_text(tmp_path / "a", "a").read_text() == "a"
    finally:
        os.umask(before)

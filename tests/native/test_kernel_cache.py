"""The cache of kernels: damaged files, files of others, folders that are full or closed."""

from __future__ import annotations

import grp
import hashlib
import os
import pwd
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from backends.native.compile_kernel import compiled_kernel
from backends.native.kernel_cache import (
    CacheLimits,
    StoredKernel,
    clean,
    kernel_folder,
    why_folder_is_not_trusted,
)
from msnn.simulation.engines.kernel_check import WrongKernelError, check_if_fresh
from tests.backends.test_atomic_write import waits_for_disk
from tests.cli.command_line import ROOT
from tests.conditions import miss, require_tool

SOURCE = "int f(void) { return 7; }\n"
ASKED = f"""
import sys
from backends.native.compile_kernel import compiled_kernel
print(compiled_kernel({SOURCE!r}).library.f())
"""
DESCRIBED = """
from backends.native.compile_kernel import kernel_description
print(kernel_description())
"""
PLANTED = "int f(void) { return 13; }\n"
FEW_BYTES = 4096


@pytest.fixture(autouse=True)
def _cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    require_tool("gcc", install="apt install gcc")
    monkeypatch.setenv("MSNN_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "own"))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))


def asked(*before: str) -> subprocess.CompletedProcess[str]:
    """The kernel in a process of its own, which a bad library may end."""
    command = [*before, sys.executable, "-c", ASKED]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)


def library_of(folder: Path) -> Path:
    (found,) = folder.glob("*.so")
    return found


def planted(library: Path) -> None:
    """Another library under the name of a kernel, as somebody with access would leave it."""
    command = ["gcc", "-shared", "-fPIC", "-x", "c", "-", "-o", str(library)]
    subprocess.run(command, input=PLANTED, text=True, check=True)
    digest = hashlib.sha256(library.read_bytes()).hexdigest()
    library.with_suffix(".sha256").write_text(digest)


@pytest.mark.parametrize("size", [0, 100, FEW_BYTES, 12_000])
def test_a_kernel_that_is_cut_off_is_built_again(tmp_path: Path, size: int) -> None:
    assert asked().stdout == "7\n"
    library = library_of(tmp_path / "cache")
    whole = library.read_bytes()
    assert size < len(whole)
    os.truncate(library, size)
    said = asked()
    assert (said.returncode, said.stdout) == (0, "7\n"), said.stderr
    assert library.read_bytes() == whole


def test_a_kernel_with_another_byte_is_built_again(tmp_path: Path) -> None:
    assert asked().stdout == "7\n"
    library = library_of(tmp_path / "cache")
    whole = library.read_bytes()
    for place in range(0, len(whole), len(whole) // 3 + 1):
        library.write_bytes(whole[:place] + bytes([whole[place] ^ 255]) + whole[place + 1 :])
        assert asked().stdout == "7\n"
        assert library.read_bytes() == whole


def test_a_seal_is_that_of_the_bytes(tmp_path: Path) -> None:
    built = compiled_kernel(SOURCE)
    built.mark_checked()
    assert compiled_kernel(SOURCE).is_checked
    (seal,) = (tmp_path / "cache").glob("*.checked")
    seal.write_text("of another library")
    assert not compiled_kernel(SOURCE).is_checked


def test_a_kernel_is_checked_until_it_was_found_right_and_never_again() -> None:
    def wrong() -> None:
        raise WrongKernelError

    for _ in range(2):
        with pytest.raises(WrongKernelError):
            check_if_fresh(compiled_kernel(SOURCE), wrong)
    checked: list[str] = []
    for number in "abc":
        check_if_fresh(compiled_kernel(SOURCE), lambda number=number: checked.append(number))
    assert checked == ["a"]


def test_a_kernel_that_is_used_is_no_old_one(tmp_path: Path) -> None:
    """Cleaning goes by the day of the last use, not by that of the build."""
    compiled_kernel(SOURCE)
    cache, now = tmp_path / "cache", time.time()
    for file in cache.iterdir():
        os.utime(file, (now - 2 * 86_400, now - 2 * 86_400))
    compiled_kernel(SOURCE)
    assert not clean(cache, CacheLimits(days=1.5))
    assert clean(cache, CacheLimits(days=0))


def test_a_library_is_on_the_disk_before_its_name_and_its_hash_after_both(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def build(library: Path, _: Path) -> None:
        library.write_bytes(b"code")

    stored = StoredKernel(tmp_path, "0" * 32)
    found = waits_for_disk(monkeypatch, stored.library)
    stored.built(build)
    named = [("file", b"code"), ("folder", b"code")]
    assert found == [("file", b""), ("folder", b"code"), *named]
    assert stored.whole() == stored.digest.read_text() == hashlib.sha256(b"code").hexdigest()


@pytest.mark.parametrize("place", ["cache", "above", "file"])
def test_what_others_may_write_is_never_loaded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: str
) -> None:
    cache = tmp_path / "above" / "cache"
    monkeypatch.setenv("MSNN_CACHE", str(cache))
    assert asked().stdout == "7\n"
    library = library_of(cache)
    planted(library)
    assert asked().stdout == "13\n"  # whoever owns the folder may do as he likes
    opened = {"cache": cache, "above": cache.parent, "file": library}[place]
    opened.chmod(0o777)
    assert asked().stdout == "7\n"
    if place == "file":
        assert kernel_folder().refused is None
        assert library.stat().st_mode & 0o22 == 0
        return
    found = kernel_folder()
    assert found.path == tmp_path / "own" / "msnn" / "kernels"
    assert found.refused is not None
    assert found.refused.is_foreign
    assert found.refused.reason == f"others may write to {opened}"
    made = library_of(tmp_path / "own" / "msnn" / "kernels")
    # the folder too, whatever the umask leaves open
    assert [place.stat().st_mode & 0o77 for place in (made, made.parent)] == [0, 0]


def test_what_belongs_to_others_is_never_loaded(tmp_path: Path) -> None:
    if os.geteuid() != 0:
        miss("only root can give files away")
    assert asked().stdout == "7\n"
    cache = tmp_path / "cache"
    os.chown(cache, 65534, 65534)
    found = kernel_folder()
    assert found.refused is not None
    assert found.refused.reason == f"{cache} belongs to nobody"
    assert asked().stdout == "7\n"
    assert library_of(tmp_path / "own" / "msnn" / "kernels").exists()
    os.chown(cache, 0, 0)
    library = library_of(cache)
    planted(library)
    os.chown(library, 65534, 65534)
    assert asked().stdout == "7\n"
    assert library.stat().st_uid == 0


def test_a_link_is_judged_by_where_it_leads(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o777)
    (tmp_path / "link").symlink_to(tmp_path / "open")
    monkeypatch.setenv("MSNN_CACHE", str(tmp_path / "link"))
    assert asked().stdout == "7\n"
    assert not list((tmp_path / "open").iterdir())
    (tmp_path / "closed").mkdir(mode=0o700)
    (tmp_path / "open" / "link").symlink_to(tmp_path / "closed")
    monkeypatch.setenv("MSNN_CACHE", str(tmp_path / "open" / "link"))
    assert kernel_folder().path == tmp_path / "open" / "link"
    assert asked().stdout == "7\n"
    library = library_of(tmp_path / "closed")
    # with a hash that is right
    planted(library)
    library.rename(tmp_path / "planted.so")
    library.symlink_to(tmp_path / "planted.so")
    assert asked().stdout == "7\n"
    assert not library.is_symlink()


def test_nothing_is_made_in_a_folder_that_others_may_write_to(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o777)
    monkeypatch.setenv("MSNN_CACHE", str(tmp_path / "open" / "new" / "cache"))
    assert asked().stdout == "7\n"
    assert list((tmp_path / "open").iterdir()) == []


@pytest.mark.parametrize("suffix", [".so", ".sha256"])
def test_a_pipe_under_the_name_of_a_kernel_holds_nobody_up(tmp_path: Path, suffix: str) -> None:
    assert asked().stdout == "7\n"
    file = library_of(tmp_path / "cache").with_suffix(suffix)
    file.unlink()
    os.mkfifo(file)
    assert asked().stdout == "7\n"
    assert file.is_file()


@pytest.mark.parametrize(
    ("primary", "name", "members", "is_trusted"),
    [
        (True, "me", [], True),
        (True, "me", ["me"], True),
        (True, "me", ["me", "other"], False),
        (True, "users", [], False),
        (False, "me", [], False),
    ],
)
def test_a_group_may_write_where_it_is_the_user_alone(
    primary: bool,
    name: str,
    members: list[str],
    is_trusted: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (folder := tmp_path / "shared").mkdir()
    folder.chmod(0o770)
    group = folder.stat().st_gid
    user = SimpleNamespace(pw_name="me", pw_gid=group if primary else group + 1)
    monkeypatch.setattr(pwd, "getpwuid", lambda _: user)
    found = SimpleNamespace(gr_name=name, gr_mem=members)
    monkeypatch.setattr(grp, "getgrgid", lambda _: found)
    expected = None if is_trusted else f"others may write to {folder}"
    assert why_folder_is_not_trusted(folder) == expected


def test_a_sticky_folder_protects_what_lies_in_it(tmp_path: Path) -> None:
    shared = tmp_path / "shared"
    shared.mkdir()
    shared.chmod(0o1777)
    (shared / "mine").mkdir(mode=0o700)
    assert why_folder_is_not_trusted(shared / "mine") is None
    assert why_folder_is_not_trusted(shared) == f"others may write to {shared}"
    assert why_folder_is_not_trusted(shared, is_above=True) is None
    # but somebody may replace the shared folder with all that lies in it
    (outer := tmp_path / "outer").mkdir()
    outer.chmod(0o777)
    (outer / "shared" / "mine").mkdir(parents=True)
    (outer / "shared").chmod(0o1777)
    assert why_folder_is_not_trusted(outer / "shared" / "mine") == f"others may write to {outer}"
    (shared / "mine").chmod(0o702)
    assert why_folder_is_not_trusted(shared / "mine") == f"others may write to {shared / 'mine'}"


def in_own_mounts(script: str) -> subprocess.CompletedProcess[str]:
    """A shell script that may mount, for itself alone."""
    require_tool("unshare", install="apt install util-linux")
    inside = ["unshare", "--user", "--map-root-user", "--mount"]
    if subprocess.run([*inside, "true"], check=False, capture_output=True).returncode != 0:
        miss("this machine lets nobody mount")
    command = [*inside, "sh", "-ec", script]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)


@pytest.mark.parametrize(
    ("mounted", "reason"),
    [
        ("-t tmpfs -o size=64k,mode=700 none", "no space left on device"),
        ("-t tmpfs -o ro,mode=700 none", "read-only file system"),
    ],
    ids=["full", "read-only"],
)
def test_a_folder_that_takes_nothing_is_worked_around(
    tmp_path: Path, mounted: str, reason: str
) -> None:
    cache = tmp_path / "cache"
    cache.mkdir(mode=0o700)
    (tmp_path / "ask.py").write_text(
        ASKED
        + "from backends.native.kernel_cache import kernel_folder\n"
        + "found = kernel_folder()\n"
        + "print(found.path, found.refused.reason, found.refused.is_foreign, sep=';')\n"
    )
    said = in_own_mounts(f"mount {mounted} {cache} && {sys.executable} {tmp_path / 'ask.py'}")
    expected = f"7\n{tmp_path / 'own' / 'msnn' / 'kernels'};{reason};False\n"
    assert (said.stdout, said.stderr) == (expected, "")


def test_kernels_that_lie_in_a_closed_folder_are_used(tmp_path: Path) -> None:
    assert asked().stdout == "7\n"
    library = library_of(tmp_path / "cache")
    (tmp_path / "ask.py").write_text(ASKED)
    folder = library.parent
    mounted = f"mount --bind {folder} {folder} && mount -o remount,ro,bind {folder}"
    said = in_own_mounts(f"{mounted} && {sys.executable} {tmp_path / 'ask.py'}")
    assert (said.stdout, said.stderr) == ("7\n", "")
    assert not (tmp_path / "own").exists()


def test_where_nothing_can_be_kept_kernels_are_built_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "file"
    file.touch()
    monkeypatch.setenv("MSNN_CACHE", str(file))
    monkeypatch.setenv("XDG_CACHE_HOME", str(file))
    taken = tmp_path / f"msnn-kernels-{os.geteuid()}"
    taken.touch()
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    before = set(tmp_path.iterdir())
    said = asked()
    assert (said.stdout, said.stderr) == ("7\n", "")
    assert set(tmp_path.iterdir()) == before


SLOW = f"""#!{sys.executable}
import os, sys, time, subprocess, pathlib
if "--version" not in sys.argv:
    child = subprocess.Popen(["sleep", "1000"])
    pathlib.Path({{started!r}}).write_text(f"{{{{os.getpid()}}}} {{{{child.pid}}}}")
    if {{hangs}}:
        child.wait()
    child.kill()
    time.sleep(0.5)
sys.exit(subprocess.run(["gcc", *sys.argv[1:]]).returncode)
"""


def slow_compiler(folder: Path, *, hangs: bool) -> tuple[Path, Path]:
    compiler, started = folder / "slow-gcc", folder / "started"
    compiler.write_text(SLOW.format(started=str(started), hangs=hangs))
    compiler.chmod(0o755)
    return compiler, started


def until(there: Path) -> None:
    end = time.monotonic() + 30
    while not there.exists() or not there.read_text():
        assert time.monotonic() < end
        time.sleep(0.01)


def are_gone(started: Path) -> bool:
    def is_gone(number: str) -> bool:
        status = Path(f"/proc/{number}/stat")
        return not status.exists() or status.read_text().rpartition(")")[2].split()[0] == "Z"

    return all(map(is_gone, started.read_text().split()))


def test_a_compiler_that_hangs_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compiler, started = slow_compiler(tmp_path, hangs=True)
    monkeypatch.setenv("CC", str(compiler))
    monkeypatch.setenv("MSNN_COMPILER_SECONDS", "0.7")
    said = asked()
    assert f"CompilerMissingError: `{compiler}` did not end within 0.7 s: set CC" in said.stderr
    assert are_gone(started)
    assert list((tmp_path / "cache").iterdir()) == []


def test_a_compiler_that_hangs_when_asked_what_it_is_is_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compiler, started = slow_compiler(tmp_path, hangs=True)
    monkeypatch.setenv("CC", str(compiler))
    monkeypatch.setenv("MSNN_COMPILER_SECONDS", "0.7")
    command = [sys.executable, "-c", DESCRIBED]
    said = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert (said.stdout, said.stderr) == ("None\n", "")
    assert are_gone(started)


@pytest.mark.parametrize("code", [ASKED, DESCRIBED], ids=["kernel", "description"])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_ends_a_compiler_that_hangs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: signal.Signals, code: str
) -> None:
    compiler, started = slow_compiler(tmp_path, hangs=True)
    monkeypatch.setenv("CC", str(compiler))
    code = f"from msnn.cli.interrupts import interrupt_on_signals\ninterrupt_on_signals(){code}"
    process = subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE, text=True)
    until(started)
    process.send_signal(number)
    _, said = process.communicate(timeout=30)
    assert "KeyboardInterrupt" in said
    assert are_gone(started)
    assert not list((tmp_path / "cache").glob("*"))


def test_ctrl_c_ends_a_training_whose_compiler_hangs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A training goes on after the first Ctrl-C, to the end of the batch."""
    compiler, started = slow_compiler(tmp_path, hangs=True)
    monkeypatch.setenv("CC", str(compiler))
    code = (
        "from backends.files import waiting\n"
        "waiting.GRACE = 0.2\n"
        "from msnn.training.records.resumable_run import end_on_interrupt\n"
        "with end_on_interrupt():\n    " + ASKED.strip().replace("\n", "\n    ")
    )
    process = subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE, text=True)
    until(started)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=30)
    assert "KeyboardInterrupt" in said
    assert are_gone(started)
    assert list((tmp_path / "cache").iterdir()) == []


def test_a_killed_builder_lets_the_next_one_build(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compiler, started = slow_compiler(tmp_path, hangs=True)
    monkeypatch.setenv("CC", str(compiler))
    first = subprocess.Popen([sys.executable, "-c", ASKED])
    until(started)
    slow_compiler(tmp_path, hangs=False)  # the key of the kernel stays the same
    second = subprocess.Popen([sys.executable, "-c", ASKED], stdout=subprocess.PIPE, text=True)
    time.sleep(0.5)
    assert second.poll() is None
    orphans = started.read_text()
    first.kill()
    first.wait()
    assert second.communicate(timeout=30)[0] == "7\n"
    for number in orphans.split():
        os.kill(int(number), signal.SIGKILL)
    assert {path.suffix for path in (tmp_path / "cache").iterdir()} == {".so", ".sha256"}


def test_two_processes_build_a_kernel_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compiler, _ = slow_compiler(tmp_path, hangs=False)
    counted = tmp_path / "counted"
    count = f'if "--version" not in sys.argv: open({str(counted)!r}, "a").write("x")\n'
    text = compiler.read_text()
    compiler.write_text(text.replace("sys.exit", f"{count}sys.exit"))
    monkeypatch.setenv("CC", str(compiler))
    processes = [
        subprocess.Popen([sys.executable, "-c", ASKED], stdout=subprocess.PIPE, text=True)
        for _ in range(3)
    ]
    assert [process.communicate(timeout=60)[0] for process in processes] == ["7\n"] * 3
    assert counted.read_text() == "x"
    assert {path.suffix for path in (tmp_path / "cache").iterdir()} == {".so", ".sha256"}

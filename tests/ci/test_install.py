"""The lock is installed by uv where it can, else by pip, and no file with another hash is."""

import hashlib
import os
import subprocess
import sys
import zipfile
from pathlib import Path
from types import ModuleType

import pytest

from tests.ci.scripts import script

WORKS = f"#!/bin/sh\nexec '{Path(sys.executable).parent / 'uv'}' \"$@\"\n"
FAILS = "#!/bin/sh\nexit 1\n"


@pytest.fixture
def set_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The set-up script on folders of the test, and packages from there alone."""
    module = script("set_up", monkeypatch)
    environment = tmp_path / "environment"
    monkeypatch.setattr(module, "ENVIRONMENT", environment)
    monkeypatch.setattr(module, "PYTHON", environment / "bin" / "python")
    monkeypatch.setattr(module, "LOCK", tmp_path / "requirements.lock")
    # the pip of the tests serves, as on a Debian without ensurepip: that is a second faster
    monkeypatch.setattr(module, "has", lambda name: name == "pip")
    for name in [name for name in os.environ if name.startswith(("PIP_", "UV_"))]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)
    monkeypatch.setenv("PIP_INDEX_URL", (tmp_path / "index").as_uri())
    monkeypatch.setenv("UV_CACHE_DIR", str(tmp_path / "cache"))
    return module


def test_uv_installs_what_is_locked(set_up: ModuleType, tmp_path: Path) -> None:
    lock(tmp_path, uv=WORKS)
    set_up.install_dependencies()
    assert installer_of_tiny(tmp_path) == "uv"


def test_a_file_with_another_hash_is_installed_by_nobody(
    set_up: ModuleType, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    lock(tmp_path, uv=WORKS, tiny_hash=hashlib.sha256(b"other").hexdigest())
    with pytest.raises(subprocess.CalledProcessError, match="pip"):
        set_up.install_dependencies()
    said = capfd.readouterr()
    assert "Hash mismatch for `tiny==1.0`" in said.err  # of uv
    assert "DO NOT MATCH THE HASHES" in said.err  # of pip
    assert "uv has not installed requirements.lock, so pip does: " in said.out
    assert not installed(tmp_path)


def test_pip_installs_where_uv_fails(set_up: ModuleType, tmp_path: Path) -> None:
    lock(tmp_path, uv=FAILS)
    set_up.install_dependencies()
    assert installer_of_tiny(tmp_path) == "pip"


def test_pip_installs_where_it_has_a_setting_of_its_own(
    set_up: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lock(tmp_path, uv=WORKS)
    monkeypatch.setenv("PIP_ONLY_BINARY", "tiny")
    set_up.install_dependencies()
    assert installer_of_tiny(tmp_path) == "pip"


def lock(folder: Path, *, uv: str, tiny_hash: str | None = None) -> None:
    """An index with a small package and a `uv` that is this script, and the lock of both."""
    of_tiny = wheel(folder / "index", "tiny", {"tiny.py": "NUMBER = 1\n"})
    of_uv = wheel(folder / "index", "uv", {"uv-1.0.data/scripts/uv": uv})
    (folder / "requirements.lock").write_text(
        f"tiny==1.0 \\\n    --hash=sha256:{tiny_hash or of_tiny}\n    # via nothing\n"
        f"uv==1.0 \\\n    --hash=sha256:{of_uv}\n    # via nothing\n",
        encoding="utf-8",
    )


def wheel(index: Path, name: str, files: dict[str, str]) -> str:
    """Writes a package where an index has it; the hash."""
    about = f"{name}-1.0.dist-info"
    files = {
        **files,
        f"{about}/METADATA": f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n",
        f"{about}/WHEEL": "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
    }
    record = "".join(f"{path},,\n" for path in (*files, f"{about}/RECORD"))
    place = index / name / f"{name}-1.0-py3-none-any.whl"
    place.parent.mkdir(parents=True)
    with zipfile.ZipFile(place, "w") as archive:
        for path, text in {**files, f"{about}/RECORD": record}.items():
            entry = zipfile.ZipInfo(path)
            entry.external_attr = 0o100755 << 16  # a file that runs
            archive.writestr(entry, text)
    link = f'<a href="{place.name}">{place.name}</a>'
    (place.parent / "index.html").write_text(f"<!DOCTYPE html><html>{link}</html>")
    return hashlib.sha256(place.read_bytes()).hexdigest()


def installer_of_tiny(folder: Path) -> str:
    (about,) = installed(folder)
    return (about / "INSTALLER").read_text(encoding="utf-8").strip()


def installed(folder: Path) -> list[Path]:
    return [*folder.glob("environment/lib/python*/site-packages/tiny-1.0.dist-info")]

"""Installs plug-ins for a test: folders on the path, with the metadata that pip would write."""

from __future__ import annotations

import importlib
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from msnn.data.formats.isolation.reader import end_readers
from spec_schema import plugins

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "plugin"

Install = Callable[..., None]
"""Installs a package: its name, its modules by names of files, the value of its entry point.

Another `version` replaces the one before.
"""


@pytest.fixture
def site(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder into which packages are installed, on the path."""
    folder = tmp_path_factory.mktemp("site")
    monkeypatch.syspath_prepend(folder)
    return folder


@pytest.fixture
def install(site: Path):
    """Installs packages until the test ends; without a call nothing is installed."""
    modules = set(sys.modules)

    def installed(package: str, files: dict[str, str], value: str, version: str = "0.1.0") -> None:
        for name, text in files.items():
            (site / name).parent.mkdir(parents=True, exist_ok=True)
            (site / name).write_text(text, encoding="utf-8")
            sys.modules.pop(name.removesuffix(".py"), None)
        # two versions of one file may have one size and one time
        shutil.rmtree(site / "__pycache__", ignore_errors=True)
        _write_metadata(site, package, value, version)
        plugins.forget()

    plugins.forget()
    yield installed
    plugins.forget()
    end_readers()
    for name in set(sys.modules) - modules:
        if str(getattr(sys.modules[name], "__file__", "")).startswith((str(site), str(EXAMPLE))):
            del sys.modules[name]


@pytest.fixture
def example(install: Install, monkeypatch: pytest.MonkeyPatch) -> None:
    """Installs examples/plugin."""
    monkeypatch.syspath_prepend(EXAMPLE)
    install("msnn-example", {}, "msnn_example:FEATURE")


@pytest.fixture
def remove(site: Path) -> Callable[[], None]:
    """Removes all plug-ins, for processes that the test starts too."""

    def removed() -> None:
        for metadata in site.glob("*.dist-info"):
            shutil.rmtree(metadata)
        importlib.invalidate_caches()
        plugins.forget()

    return removed


def _write_metadata(site: Path, package: str, value: str, version: str) -> None:
    name = package.replace("-", "_")
    for before in site.glob(f"{name}-*.dist-info"):
        shutil.rmtree(before)
    folder = site / f"{name}-{version}.dist-info"
    folder.mkdir()
    metadata = f"Metadata-Version: 2.1\nName: {package}\nVersion: {version}\n"
    (folder / "METADATA").write_text(metadata)
    (folder / "entry_points.txt").write_text(f"[{plugins.GROUP}]\nexample = {value}\n")

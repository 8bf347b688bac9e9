"""Installs plug-ins for a test: folders on the path, with the metadata that pip would write."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from msnn.data.formats.isolation.reader import end_readers
from spec_schema import plugins

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "plugin"

Install = Callable[..., None]
"""Installs a package: its name, its modules by names of files, the value of its entry point."""


@pytest.fixture
def install(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch):
    """Installs packages until the test ends; without a call nothing is installed."""
    site = tmp_path_factory.mktemp("site")
    monkeypatch.syspath_prepend(site)
    modules = set(sys.modules)

    def installed(package: str, files: dict[str, str], value: str) -> None:
        for name, text in files.items():
            (site / name).parent.mkdir(parents=True, exist_ok=True)
            (site / name).write_text(text, encoding="utf-8")
        _write_metadata(site, package, value)
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


def _write_metadata(site: Path, package: str, value: str) -> None:
    folder = site / f"{package.replace('-', '_')}-0.1.0.dist-info"
    folder.mkdir(exist_ok=True)
    (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 0.1.0\n")
    (folder / "entry_points.txt").write_text(f"[{plugins.GROUP}]\nexample = {value}\n")

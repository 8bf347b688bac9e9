"""A plug-in is built, installed by pip beside the wheel without a network, and used."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from importlib.metadata import distribution
from pathlib import Path

import pytest

from tests.light.conftest import built
from tests.light.test_light import light_packages

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / "examples" / "plugin"
SPEC = """msnn: 1
name: m
sample_time: 1 s
inputs: {u: {range: [-1, 1]}}
outputs: {y: 2 * u}
budget: {operations: 20}
export: {datasheet: {}}
data: {source: {train: log.jsonl}}
"""


@pytest.fixture(scope="module")
def environment(wheel: zipfile.ZipFile, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A virtual environment with both wheels and links to the packages that msnn needs."""
    folder = tmp_path_factory.mktemp("environment")
    plugin = built(EXAMPLE, tmp_path_factory.mktemp("plugin"))
    _run(sys.executable, "-m", "venv", "--without-pip", str(folder))
    python = folder / "bin" / "python"
    options = ("--no-index", "--no-deps", "--no-compile", "--quiet", "--disable-pip-version-check")
    _run(
        *(sys.executable, "-m", "pip", "--python", str(python), "install", *options),
        *(str(each.filename) for each in (wheel, plugin)),
    )
    (site,) = folder.glob("lib/python*/site-packages")
    # one by one: the environment of the tests has the checkout on its path
    for package in light_packages():
        found = distribution(package)
        for top in {file.parts[0] for file in found.files or () if file.parts[0] != ".."}:
            source = Path(str(found.locate_file(top)))
            if source.exists() and top != "__pycache__" and not (site / top).exists():
                (site / top).symlink_to(source)
    return folder


def test_the_example_works_where_pip_installed_it(environment: Path, tmp_path: Path):
    (tmp_path / "m.msnn.yaml").write_text(SPEC)
    (tmp_path / "log.jsonl").write_text("".join(f'{{"u": {k / 10}}}\n' for k in range(9)))
    msnn = str(environment / "bin" / "msnn")
    assert "budget: 3 of 20 operations" in _run(msnn, "show", "m.msnn.yaml", cwd=tmp_path)
    _run(msnn, "export", "m.msnn.yaml", "--initial", "--out", "out", cwd=tmp_path)
    sheet = (tmp_path / "out" / "datasheet" / "m.md").read_text()
    assert "with msnn-example 0.1.0" in sheet
    assert "u                    9" in _run(msnn, "data", "m.msnn.yaml", cwd=tmp_path)
    assert "msnn-example" in _run(msnn, "doctor", cwd=tmp_path)
    assert "Multiply         1" in _run(msnn, "operations", "m.msnn.yaml", cwd=tmp_path)


def _run(*command: str, cwd: Path | None = None) -> str:
    done = subprocess.run(command, cwd=cwd, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout

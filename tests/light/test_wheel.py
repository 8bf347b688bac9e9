"""The wheel carries the packages with their templates below `msnn`, and nothing else."""

import ast
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

from hatch_build import relocated
from tests.light.conftest import built
from tests.light.session import OURS

ROOT = Path(__file__).resolve().parents[2]


def test_it_claims_one_name(wheel: zipfile.ZipFile):
    top = {name.partition("/")[0] for name in wheel.namelist()}
    assert {name for name in top if not name.endswith(".dist-info")} == {"msnn"}


def test_it_holds_every_file_of_the_folders(wheel: zipfile.ZipFile):
    here = {
        path.relative_to(ROOT / "msnn" if package == "msnn" else ROOT).as_posix()
        for package in ("msnn", *OURS)
        for path in (ROOT / package).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts and path.name != "decisions.md"
    }
    files = {name for name in wheel.namelist() if name.startswith("msnn/")}
    assert files == {f"msnn/{name}" for name in here}


def test_no_file_of_it_imports_a_name_that_it_does_not_bring(wheel: zipfile.ZipFile):
    for name in wheel.namelist():
        if not name.endswith(".py"):
            continue
        for node in ast.walk(ast.parse(wheel.read(name))):
            match node:
                case ast.ImportFrom(module=str(module), level=0):
                    assert module.partition(".")[0] not in OURS, name
                case ast.Import(names=names):
                    assert not OURS & {alias.name.partition(".")[0] for alias in names}, name
                case _:
                    pass


def test_only_names_of_modules_change():
    source = (
        "from compiler.ir import ops  # from compiler\n"
        "import templates\n"
        "import compilers\n"
        "def f():\n"
        "    from backends.ports import x; 'ä'; home = 'spec_schema.version'\n"
        "    return 'compiler', 'compiler.c', 'templates.html', home\n"
    )
    assert relocated(source, ROOT) == (
        "from msnn.compiler.ir import ops  # from compiler\n"
        "from msnn import templates\n"
        "import compilers\n"
        "def f():\n"
        "    from msnn.backends.ports import x; 'ä'; home = 'msnn.spec_schema.version'\n"
        "    return 'compiler', 'compiler.c', 'templates.html', home\n"
    )


@pytest.mark.parametrize("source", ["import compiler.ir\n", "import templates, os\n"])
def test_an_import_that_cannot_be_moved_is_refused(source: str):
    with pytest.raises(ValueError, match="line 1: write `from … import …`"):
        relocated(source, ROOT)


def test_the_source_archive_makes_the_same_wheel(wheel: zipfile.ZipFile, tmp_path: Path):
    command = [sys.executable, "-m", "hatchling", "build", "--target", "sdist"]
    subprocess.run(
        [*command, "--directory", str(tmp_path)], cwd=ROOT, check=True, capture_output=True
    )
    (archive,) = tmp_path.glob("*.tar.gz")
    with tarfile.open(archive) as files:
        files.extractall(tmp_path, filter="data")
    other = built(tmp_path / archive.name.removesuffix(".tar.gz"), tmp_path / "again")
    assert {name: other.read(name) for name in other.namelist()} == {
        name: wheel.read(name) for name in wheel.namelist()
    }


def test_it_starts_the_command_and_carries_the_licence(wheel: zipfile.ZipFile):
    (entry_points,) = [name for name in wheel.namelist() if name.endswith("entry_points.txt")]
    assert "msnn = msnn.cli.main:main" in wheel.read(entry_points).decode()
    assert any(name.endswith(".dist-info/licenses/LICENSE") for name in wheel.namelist())


def test_its_version_is_in_the_changelog(wheel: zipfile.ZipFile):
    (metadata,) = [name for name in wheel.namelist() if name.endswith(".dist-info/METADATA")]
    lines = wheel.read(metadata).decode().splitlines()
    (version,) = [line.removeprefix("Version: ") for line in lines if line.startswith("Version: ")]
    assert f"## {version}" in (ROOT / "CHANGELOG.md").read_text()

"""msnn refuses to run when a stranger's module stands where one of its packages is looked for."""

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from msnn.project.package_names import COMPANIONS, check_package_names

ROOT = Path(__file__).resolve().parent.parent


def test_the_names_are_ours_here():
    check_package_names()


@pytest.mark.parametrize("name", COMPANIONS)
@pytest.mark.parametrize("kind", ["module", "package"])
def test_a_stranger_of_that_name_is_refused(tmp_path: Path, name: str, kind: str):
    place = tmp_path / f"{name}.py" if kind == "module" else tmp_path / name / "__init__.py"
    place.parent.mkdir(exist_ok=True)
    place.write_text("raise SystemExit('the check must not import this')\n")
    found = place if kind == "module" else place.parent
    result = check_in_new_process(first=tmp_path)
    assert result.returncode == 1
    assert result.stderr.strip().splitlines()[-1] == (
        f"ImportError: msnn needs the name `{name}` for its package, but Python finds {found} "
        "first: rename that one or run msnn from another folder."
    )


def test_a_missing_package_is_named(tmp_path: Path):
    """A copy of msnn alone, and a search path that holds nothing else of ours."""
    (tmp_path / "msnn").symlink_to(ROOT / "msnn")
    result = check_in_new_process(msnn=tmp_path / "msnn", options=["-I", "-S"])
    assert result.returncode == 1
    assert result.stderr.strip().splitlines()[-1] == (
        "ImportError: msnn is installed incompletely: its package `spec_schema` is missing."
    )


def check_in_new_process(
    first: Path | None = None, msnn: Path = ROOT / "msnn", options: Sequence[str] = ()
) -> "subprocess.CompletedProcess[str]":
    """Runs the check alone, in a fresh interpreter that looks in `first` before anywhere else."""
    program = "\n".join(
        [
            "import importlib.util, sys",
            "first, checker = sys.argv[1:]",
            "sys.path[:0] = first.split(':') if first else []",
            "spec = importlib.util.spec_from_file_location('checker', checker)",
            "checker = importlib.util.module_from_spec(spec)",
            "spec.loader.exec_module(checker)",
            "checker.check_package_names()",
        ]
    )
    path = f"{first}:{ROOT}" if first else ""
    command = [
        sys.executable,
        *options,
        "-c",
        program,
        path,
        str(msnn / "project" / "package_names.py"),
    ]
    return subprocess.run(command, capture_output=True, text=True, check=False)

"""The MISRA addon runs with the Python that runs msnn; where it cannot run, nothing is claimed."""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from backends.c_kernels.sources import c_sources
from compiler.kernels.table import KERNELS
from msnn.verification import host_checks
from msnn.verification.exported_c import CFolder
from msnn.verification.host_checks import misra_check
from msnn.verification.proof_step import CPPCHECK, Result
from tests.conditions import require_tool

BREACH = "static int own_bad(int x) { if (x) goto out; return 1; out: return 0; }\n"
"""An `if` of what is no truth value."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Written(CFolder):
    prefix: str = "own"
    calibration: str | None = None


def judged(text: str, folder: Path) -> Result:
    require_tool(CPPCHECK.command, f"apt install {CPPCHECK.package}")
    model = Written(folder=folder)
    (folder / "src").mkdir()
    (folder / "include").mkdir()
    (folder / "src" / "own.c").write_text(text, encoding="utf-8")
    return misra_check(model).result(folder / "checked")


def test_a_breach_is_a_finding_whatever_python_is_on_the_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("python3", "python"):
        other = tmp_path / name
        other.write_text("#!/bin/sh\nexit 1\n", encoding="utf-8")
        other.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    result = judged(BREACH, tmp_path)
    assert result.findings == ("src/own.c:1 misra-c2012-14.4",)


@pytest.mark.parametrize(
    ("folder", "said"),
    [("a folder", "1 findings by the MISRA addon"), ("nowhere", "could not run its MISRA addon")],
)
def test_an_addon_that_cannot_run_has_not_found_nothing(
    folder: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = tmp_path / "a folder"
    place.mkdir()
    (place / "python").symlink_to(Path(sys.executable).resolve())
    python = tmp_path / folder / "python"
    monkeypatch.setattr(host_checks, "MISRA", ("--addon=misra", f"--addon-python={python}"))
    result = judged(BREACH, tmp_path)
    assert result.verdict == "found"
    assert said in result.detail


def test_what_is_for_clang_alone_is_a_pragma() -> None:
    """The addon does not read it."""
    exported = sorted((Path(__file__).parents[1] / "golden").glob("c_*/*.c"))
    texts = [path.read_text(encoding="utf-8") for path in exported]
    texts.append(c_sources(list(KERNELS), "float", "own").source)
    for text in texts:
        found = re.findall(r"#ifdef __clang__\n(.*?)#endif", text, re.DOTALL)
        assert {*found} <= {"#pragma STDC FP_CONTRACT OFF\n"}
        assert text.count("__clang__") == len(found)
    assert "__clang__" in texts[0]
    assert "__clang__" in texts[-1]


def test_its_temporary_files_are_not_beside_the_sources(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another check, which runs at the same time, would report them as files of the export."""
    commands: list[list[str | Path]] = []
    real = host_checks.run_tool

    def noted(command: list[str | Path], folder: Path) -> str:
        commands.append(command)
        return real(command, folder)

    monkeypatch.setattr(host_checks, "run_tool", noted)
    judged(BREACH, tmp_path)
    words = [str(word) for word in commands[0]]
    places = [word for word in words if word.startswith("--cppcheck-build-dir=")]
    assert [Path(place.partition("=")[2]).parent for place in places] == [tmp_path / "checked"]

"""The check by sanitizers says whether a sanitizer, the build or the program itself failed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

from msnn.verification.host_builds import sanitizers_check
from msnn.verification.proof_step import GCC, Tool, run_tool
from tests.conditions import require_tool

PROGRAMS = {
    "no such function": (
        "int f(int); int main(void) { return f(0); }",
        "gcc failed, and no sanitizer found anything",
    ),
    "no C": ("int main(void) { return }", "gcc failed, and no sanitizer found anything"),
    "an end of its own": (
        "int main(void) { return 3; }",
        "main failed, and no sanitizer found anything",
    ),
    "an overflow": (
        "int main(int n, char **c) { (void)c; volatile int a = 0x7fffffff; a += n; return 0; }",
        "a sanitizer stopped",
    ),
    "memory beside an array": (
        "int main(int n, char **c) { int a[2] = {0}; (void)c; return *(&a[1] + 2 * n); }",
        "a sanitizer stopped",
    ),
    "no fault": ("int main(void) { return 0; }", "address, undefined behaviour"),
}


@pytest.mark.parametrize("name", PROGRAMS)
def test_only_a_sanitizer_stops_a_program_in_the_name_of_one(name: str, tmp_path: Path) -> None:
    require_tool("gcc", install="apt install gcc")
    text, detail = PROGRAMS[name]

    def faults(tool: Tool, flags: Sequence[str], folder: Path) -> list[str]:
        (folder / "main.c").write_text(text)
        run_tool([tool.command, *flags, "main.c", "-o", "main"], folder)
        run_tool([folder / "main"], folder)
        return []

    result = sanitizers_check("golden vectors", faults).result(tmp_path / "built")
    told = result.detail.removeprefix(f"{tmp_path / 'built'}/")
    assert told.startswith(detail)
    assert (result.verdict == "found") == (name != "no fault")
    assert result.target == GCC.command

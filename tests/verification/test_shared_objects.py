"""Objects that several checks link are compiled once for each compiler and its flags."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import pytest

from msnn.verification.exported_c import CFolder
from msnn.verification.host_builds import SharedObjects
from msnn.verification.proof_step import CLANG, GCC, ToolFailedError
from tests.conditions import require_tool


@dataclass(frozen=True, slots=True, kw_only=True)
class Export(CFolder):
    """Two files of C."""

    prefix: str = "m"
    calibration: str | None = None


@pytest.fixture
def export(tmp_path: Path) -> Export:
    require_tool("gcc", install="apt install gcc")
    (tmp_path / "src").mkdir()
    (tmp_path / "src" / "m.c").write_text("int m(int x) { return 3 * x; }\n", encoding="utf-8")
    (tmp_path / "src" / "other.c").write_text("int other;\n", encoding="utf-8")
    return Export(folder=tmp_path)


def place(export: Export, name: str) -> Path:
    folder = export.folder / name
    folder.mkdir()
    return folder


def test_checks_side_by_side_link_the_same_objects(export: Export) -> None:
    shared = SharedObjects(export)
    folders = [place(export, str(number)) for number in range(4)]
    with ThreadPoolExecutor(4) as pool:
        first, *others = pool.map(lambda folder: shared.of(GCC, ("-O0",), folder), folders)
    assert [path.name for path in first] == ["m.o", "other.o"]
    assert others == [first] * 3
    assert len(list(export.folder.rglob("*.o"))) == 2
    # nothing is left to compile for who comes later
    (export.folder / "src" / "m.c").write_text("no C", encoding="utf-8")
    assert shared.of(GCC, ("-O0",), place(export, "later")) == first


def test_others_have_other_objects_in_one_folder(export: Export) -> None:
    require_tool("clang", install="apt install clang")
    shared, folder = SharedObjects(export), place(export, "levels")
    plain = shared.of(GCC, ("-O0",), folder)
    before = plain[0].read_bytes()
    for tool, flags in ((GCC, ("-O0", "-g")), (CLANG, ("-O0",))):
        assert shared.of(tool, flags, folder)[0].read_bytes() != before
    assert shared.of(GCC, ("-O0",), folder)[0].read_bytes() == before


def test_who_comes_after_a_failure_hears_of_it_too(export: Export) -> None:
    (export.folder / "src" / "m.c").write_text("no C", encoding="utf-8")
    shared, folder = SharedObjects(export), place(export, "failed")
    for _ in range(2):
        with pytest.raises(ToolFailedError) as caught:
            shared.of(GCC, ("-O0",), folder)
        assert any("error:" in line for line in caught.value.lines)

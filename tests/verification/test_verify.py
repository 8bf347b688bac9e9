"""`msnn verify` on the gallery: nothing to find there, and every kind of fault is found."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

from backends.c.selftest.selftest_text import FROM_INIT
from compiler.kernels.table import KERNELS
from msnn.cli.application import run
from msnn.verification.coverage import coverage_check
from msnn.verification.exported_c import read_exported_c
from msnn.verification.host_builds import LEVELS
from msnn.verification.proof.assumptions import KNOWN
from msnn.verification.proof_step import (
    ARM_GCC,
    ARM_QEMU,
    CLANG,
    CPPCHECK,
    FRAMA_C,
    GCC,
    GCOV,
    LIBFUZZER,
    RISCV_GCC,
    RISCV_QEMU,
    Tool,
)
from tests.conditions import miss
from tests.examples.gallery import GALLERY, NAMES, spec_of
from tests.verification.unreached import UNREACHED

HOST = (GCC, GCOV, CLANG, CPPCHECK, FRAMA_C)
BOARDS = (ARM_GCC, ARM_QEMU, RISCV_GCC, RISCV_QEMU)

PLANT = """
msnn: 1
name: plant
sample_time: 1 s
inputs:
  u: {range: [0, 2]}
outputs:
  y: 1 / (u - 1)
"""


UNBOUNDED = """
msnn: 1
name: plant
sample_time: 1 s
inputs:
  u: {range: [0, 2]}
states:
  x: {next: 0.5 * x + u, init: 0}
outputs:
  y: tanh(x) - u
"""


def require(*tools: Tool) -> None:
    for tool in tools:
        if not tool.is_there:
            miss(f"{tool.command} is not installed: apt-get install {tool.package}")


def exported(spec: Path, folder: Path) -> Path:
    assert run(["export", str(spec), "--initial", "--to", "c", "--out", str(folder)]) == 0
    return folder / "c"


def verified(
    capsys: pytest.CaptureFixture[str], folder: Path, *options: str
) -> tuple[int, dict[str, Any]]:
    capsys.readouterr()
    code = run(["verify", str(folder), "--format", "json", *options])
    return code, json.loads(capsys.readouterr().out)


def unreached(results: Iterable[dict[str, Any]]) -> set[str]:
    """What golden steps and self-test do not reach, without the names of files."""
    (coverage,) = [result for result in results if result["check"] == "coverage"]
    assert coverage["detail"]
    return {note.split(": ", 1)[1] for note in coverage["notes"]}


@pytest.fixture(autouse=True)
def one_level(monkeypatch: pytest.MonkeyPatch) -> None:
    """All five have their turn with the reference model."""
    monkeypatch.setattr("msnn.verification.host_builds.LEVELS", ("-O2",))


def test_the_reference_model_on_every_target(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    require(*HOST, *BOARDS)
    monkeypatch.setattr("msnn.verification.host_builds.LEVELS", LEVELS)
    folder = exported(spec_of(GALLERY, "reference"), tmp_path)
    code, said = verified(capsys, folder, "--targets", "all", "--proof", "--misra")
    assert code == 0, said
    assert unreached(said["results"]) == set(UNREACHED.get("reference", {}))
    figures = {r["target"]: r["figures"][0] for r in said["results"] if r["figures"]}
    assert len(figures) == 10
    for board in figures.values():
        least, mean, most = board["instructions"]
        assert 100 < least <= mean <= most < 20_000
        assert board["data"] == 0
        assert 500 < board["flash"] < 8_000
        # the samples of the window and the speed
        assert 25 * 4 <= board["bss"] <= 128
        assert board["stack_bound"] is None or board["stack_painted"] <= board["stack_bound"]
    report = (folder / "REPORT.md").read_text(encoding="utf-8")
    assert "# Verification of `reference`" in report
    assert "\n| reference.msnn.yaml:27 | next(v), v_next | reference.c:" in report
    assert "| reference.msnn.yaml:22 |  |\n" in report


PROVED = ("two_tanks", "battery", "arm_friction")
"""Roots and quotients; a table and a filter; a network. `benchmarks/embedded_c/gallery.py` proves
all of them, which takes minutes."""


@pytest.mark.parametrize("name", PROVED)
def test_models_of_the_gallery_have_nothing_to_find(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    require(*HOST)
    # the reference model has all levels; of these each has two
    turn = PROVED.index(name)
    monkeypatch.setattr("msnn.verification.host_builds.LEVELS", (LEVELS[turn], LEVELS[turn + 2]))
    folder = exported(spec_of(GALLERY, name), tmp_path)
    code, said = verified(capsys, folder, "--misra", "--proof")
    assert code == 0, said
    assert unreached(said["results"]) == set(UNREACHED.get(name, {}))


@pytest.mark.parametrize("name", [name for name in NAMES if name not in ("reference", *PROVED)])
def test_the_gallery_is_reached_but_for_what_has_a_reason(name: str, tmp_path: Path) -> None:
    """What else is checked of exports is so in `tests/backends/c`, of programs of every kind."""
    require(GCC, GCOV)
    model = read_exported_c(exported(spec_of(GALLERY, name), tmp_path))
    result = coverage_check(model).result(tmp_path / "checked")
    assert unreached([asdict(result)]) == set(UNREACHED.get(name, {}))


@pytest.mark.parametrize("name", ["reference", "tyre", "two_tanks"])
def test_constant_time_takes_the_same_instructions_for_all_steps(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    require(GCC, ARM_GCC, ARM_QEMU)
    text = spec_of(GALLERY, name).read_text(encoding="utf-8")
    assert "c: {}" in text
    spec = tmp_path / f"{name}.msnn.yaml"
    spec.write_text(text.replace("c: {}", "c: {constant_time: true}"), encoding="utf-8")
    folder = exported(spec, tmp_path)
    code, said = verified(capsys, folder, "--targets", "m4", "--misra")
    assert code == 0, said
    figures = [figure for result in said["results"] for figure in result["figures"]]
    assert len(figures) == 2
    expected = folder / "test" / f"{name}_expected.txt"
    steps = sum(map(bool, expected.read_text(encoding="utf-8").splitlines()))
    for figure in figures:
        least, mean, most = figure["instructions"]
        # a window is filled by the one step that follows init, in every run without a past
        assert round(mean * steps) == least * (steps - FROM_INIT) + most * FROM_INIT
        assert name == "reference" or least == most


def test_double_precision_runs_where_there_is_no_c_library(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    require(GCC, RISCV_GCC, RISCV_QEMU)
    text = spec_of(GALLERY, "two_tanks").read_text(encoding="utf-8")  # it takes roots
    spec = tmp_path / "two_tanks.msnn.yaml"
    spec.write_text(text.replace("c: {}", "c: {dtype: float64}"), encoding="utf-8")
    code, said = verified(capsys, exported(spec, tmp_path), "--targets", "rv32")
    assert code == 0, said
    assert [result["verdict"] for result in said["results"]] == ["ok"] * 5


def test_a_changed_constant_differs_from_the_golden_vectors(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    require(GCC, CLANG, ARM_GCC, ARM_QEMU)
    folder = exported(spec_of(GALLERY, "reference"), tmp_path)
    source = folder / "src" / "reference.c"
    text = source.read_text(encoding="utf-8")
    assert "0.05f" in text
    source.write_text(text.replace("0.05f", "0.0500001f"), encoding="utf-8")
    code, said = verified(capsys, folder, "--targets", "host,m4")
    assert code == 1
    found = {(r["check"], r["target"]) for r in said["results"] if r["verdict"] == "found"}
    assert found == {
        ("golden vectors", "gcc"),
        ("golden vectors", "clang"),
        ("files", "all"),
        ("golden vectors", "Cortex-M4F -O2"),
        ("golden vectors", "Cortex-M4F -Os"),
    }


def test_a_warning_and_a_breach_of_misra_are_findings(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    require(GCC, CLANG, CPPCHECK)
    folder = exported(spec_of(GALLERY, "two_tanks"), tmp_path)
    source = folder / "src" / "two_tanks.c"
    with source.open("a", encoding="utf-8") as file:
        file.write("int stray(double x) { if (x == 1.0) goto out; return 1; out: return 0; }\n")
        file.write("int *of_no_cpp(void *x) { return x; }\n")
    code, said = verified(capsys, folder, "--misra")
    assert code == 1
    found = {(r["check"], r["target"]): " ".join(r["findings"]) for r in said["results"]}
    assert "-Wfloat-equal" in found["warnings", "gcc"]
    assert "-Wmissing-prototypes" in found["warnings", "clang"]
    assert "invalid conversion" in found["warnings", "g++"]
    assert "misra-c2012-8.4" in found["misra", "source"]


def test_a_source_that_the_misra_check_cannot_read_is_a_finding(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """cppcheck ends well all the same, and says nothing else of that source."""
    require(CPPCHECK)
    folder = exported(spec_of(GALLERY, "two_tanks"), tmp_path)
    stray = folder / "src" / "stray.c"
    stray.write_text("int stray(void) { return 1 +; }\n", encoding="utf-8")
    code, said = verified(capsys, folder, "--targets", "", "--misra")
    assert code == 1
    assert said["results"][1]["findings"] == ["src/stray.c:1 syntaxError"]


def test_a_division_by_zero_is_an_alarm_with_its_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    require(FRAMA_C)
    spec = tmp_path / "plant.msnn.yaml"
    spec.write_text(PLANT, encoding="utf-8")
    code, said = verified(capsys, exported(spec, tmp_path), "--targets", "", "--proof")
    assert code == 1
    (line,) = said["results"][1]["findings"]
    assert "div" in line
    assert "(spec plant.msnn.yaml:8)" in line


def test_what_the_spec_does_not_bound_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    require(FRAMA_C)
    spec = tmp_path / "plant.msnn.yaml"
    spec.write_text(UNBOUNDED, encoding="utf-8")
    _, said = verified(capsys, exported(spec, tmp_path), "--targets", "", "--proof")
    notes = said["results"][1]["notes"]
    assert "assumed |x| <= 1e+06: the spec has no range" in notes
    assert "proved y in -3 .. 1" in notes


def test_the_fuzzer_finds_a_write_outside_an_array(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    require(CLANG, LIBFUZZER)
    folder = exported(spec_of(GALLERY, "reference"), tmp_path)
    assert verified(capsys, folder, "--targets", "", "--fuzz", "1")[0] == 0
    source = folder / "src" / "reference.c"
    text = source.read_text(encoding="utf-8")
    weak = "    s->u_history[s->ready * 1000U] = 0.0f;\n    /* outputs */\n"
    source.write_text(text.replace("    /* outputs */\n", weak), encoding="utf-8")
    code, said = verified(capsys, folder, "--targets", "", "--fuzz", "10")
    assert code == 1
    assert any("runtime error" in line for line in said["results"][1]["findings"])


def test_a_missing_tool_is_named_and_the_rest_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    require(GCC)
    folder = exported(spec_of(GALLERY, "tyre"), tmp_path)
    tools = tmp_path / "tools"
    tools.mkdir()
    for command in ("gcc", "gcov", "as", "ld"):
        found = shutil.which(command)
        assert found is not None
        (tools / command).symlink_to(found)
    monkeypatch.setenv("PATH", str(tools))
    code, said = verified(capsys, folder, "--targets", "host,m0", "--proof")
    assert code == 5
    assert said["install"] == (
        "apt-get install clang g++ binutils gcc-arm-none-eabi libnewlib-arm-none-eabi "
        "qemu-system-arm frama-c-base"
    )
    verdicts = {(r["check"], r["target"]): r["verdict"] for r in said["results"]}
    assert verdicts["golden vectors", "gcc"] == "ok"
    assert verdicts["golden vectors", "clang"] == "missing"


def test_a_folder_without_an_export_is_a_diagnostic(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.json").write_text("[1]", encoding="utf-8")
    assert run(["verify", str(tmp_path)]) == 1
    assert "error[E1046]" in capsys.readouterr().err


def test_names_that_are_no_c_names_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = exported(spec_of(GALLERY, "tyre"), tmp_path)
    about = folder / "tyre.json"
    text = about.read_text(encoding="utf-8").replace('"prefix": "tyre"', '"prefix": "../tyre"')
    about.write_text(text, encoding="utf-8")
    assert run(["verify", str(folder)]) == 1
    assert "error[E1046]" in capsys.readouterr().err


def test_an_unknown_target_is_a_usage_error(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["verify", ".", "--targets", "m4,avr"]) == 2
    assert "`avr` is none of host, m4, m7, m0, rv32 and all" in capsys.readouterr().err


@pytest.mark.parametrize("targets", ["", " , "])
def test_checking_nothing_is_a_usage_error(
    targets: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A script whose variable is unset would be told that all is well."""
    assert run(["verify", str(tmp_path), "--targets", targets]) == 2
    assert "nothing is left to check" in capsys.readouterr().err


def test_every_kernel_has_bounds_for_the_proof() -> None:
    assert set(KERNELS) == KNOWN

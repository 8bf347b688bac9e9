"""`msnn verify` of controllers and filters: nothing to find in them, and every kind of fault is."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from msnn.cli.application import run
from msnn.features.control.verification.exported_controller import read_exported_controller
from msnn.features.control.verification.host import online_host_checks
from msnn.verification.proof_step import ARM_GCC, ARM_QEMU, CLANG, GCC, LIBFUZZER, Tool
from tests.conditions import miss

PLANT = """
msnn: 1
name: plant
sample_time: 0.1 s
inputs: {u: {between: hold}, d: {between: hold}}
states: {x: {next: 0.9 * x + 0.2 * u + 0.1 * d + 0.05 * sin(x), init: 0, range: [-2, 2]}}
outputs: {y: {expr: next(x), predicts: "x[t+1]"}}
mpc:
  horizon: 6
  controls: [u]
  cost: {stage: "(x - r)**2 + 0.1 * (u - u[t-1])**2", terminal: 5 * (x - r)**2}
  references: {r: {}}
  bounds: {u: {min: -1, max: 1, rate: 3 1/s}, x: {max: 0.5}}
estimator: {ekf: {measured: {y: 0.1}, process: {x: 0.1}, initial: {x: 1}}}
export: {mpc: {dtype: float32}}
"""
FILTER = re.sub(r"mpc:\n  horizon.*?(?=estimator)", "", PLANT, flags=re.DOTALL)
"""The same without its controller."""


def require(*tools: Tool) -> None:
    for tool in tools:
        if not tool.is_there:
            miss(f"{tool.command} is not installed: apt-get install {tool.package}")


def exported(folder: Path, text: str = PLANT) -> Path:
    spec = folder / "plant.msnn.yaml"
    spec.write_text(text, encoding="utf-8")
    assert run(["export", str(spec), "--initial", "--to", "mpc", "--out", str(folder)]) == 0
    return folder / "mpc"


def verified(
    capsys: pytest.CaptureFixture[str], folder: Path, *options: str
) -> tuple[int, dict[tuple[str, str], Any]]:
    """The exit code, and results by check and target."""
    capsys.readouterr()
    code = run(["verify", str(folder), "--format", "json", *options])
    said = json.loads(capsys.readouterr().out)
    return code, {(result["check"], result["target"]): result for result in said["results"]}


def test_nothing_is_found_in_a_controller_and_its_filter(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    require(GCC, CLANG, LIBFUZZER, ARM_GCC, ARM_QEMU)
    monkeypatch.setattr("msnn.verification.host_builds.LEVELS", ("-O0", "-O2"))
    folder = exported(tmp_path)
    code, said = verified(capsys, folder, "--targets", "host,m4,m0", "--fuzz", "1", "--proof")
    assert code == 0, said
    assert said["proof", "plant_mpc"]["verdict"] == "left out"
    for target in ("Cortex-M4F -O2", "Cortex-M0 -Os"):
        board = said["golden solves", target]
        assert "0 bits differ; at most 100 × " in board["detail"]
        figures = {figure["of"]: figure for figure in board["figures"]}
        assert set(figures) == {"solve", "prepare", "feedback", "correct", "predict"}
        for figure in figures.values():
            least, mean, most = figure["instructions"]
            assert 0 < least <= mean <= most
            assert least <= figure["median"] <= most
            # the square root of the C library keeps errno where the core has none
            assert figure["data"] == 0 or target.startswith("Cortex-M0")
            assert figure["stack_painted"] <= (figure["stack_bound"] or 1 << 20)
        assert figures["feedback"]["instructions"][2] < figures["solve"]["instructions"][0]
        # the structs of both
        assert 2_000 < figures["solve"]["bss"] < 8_000
    report = (folder / "REPORT.md").read_text(encoding="utf-8")
    assert re.search(r"\n\| Cortex-M4F -O2 solve \| \d+ \| ", report)


@pytest.mark.parametrize("structure", ["staged", "condensed"])
def test_nothing_is_found_in_blocks_within_limits_that_move(structure: str, tmp_path: Path) -> None:
    require(GCC)
    text = re.sub(r"estimator:.*\n", "", PLANT)
    text = text.replace("r: {}", "r: {}, top: {preview: true}")
    text = text.replace("max: 1,", "max: sqrt(1 + top),")
    blocks = f"  blocks: [1, 2, 3]\n  solver: {{interior_point: {{structure: {structure}}}}}\n"
    model = read_exported_controller(
        exported(tmp_path, text.replace("export:", blocks + "export:"))
    )
    assert model is not None
    steps = [s for s in online_host_checks(model) if s.target == "gcc"]
    wanted = {"golden solves", "sanitizers", "drawn numbers"}
    found = {s.name: s.result(tmp_path / s.name) for s in steps if s.name in wanted}
    assert {*found} == wanted
    assert all(result.verdict == "ok" for result in found.values()), found


def test_a_filter_alone_is_verified(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    require(GCC, CLANG, ARM_GCC, ARM_QEMU)
    folder = exported(tmp_path, FILTER)
    assert not list(folder.glob("src/*_mpc.c"))
    code, said = verified(capsys, folder, "--targets", "host,m4")
    assert code == 0, said
    figures = said["golden solves", "Cortex-M4F -Os"]["figures"]
    assert [figure["of"] for figure in figures] == ["correct", "predict"]


def test_a_window_is_verified(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    require(GCC, CLANG, ARM_GCC, ARM_QEMU)
    folder = exported(tmp_path, FILTER.replace("ekf: {", "mhe: {horizon: 3, "))
    code, said = verified(capsys, folder, "--targets", "host,m4")
    assert code == 0, said
    board = said["golden solves", "Cortex-M4F -Os"]
    assert [figure["of"] for figure in board["figures"]] == ["correct", "predict"]
    assert "instructions a correction" in board["detail"]
    source = folder / "src" / "plant_mhe_window.c"
    c = source.read_text(encoding="utf-8")
    assert c.count("if (c->residual <= TOLERANCE) {") == 1
    source.write_text(c.replace("if (c->residual <= TOLERANCE) {", "{"))
    model = read_exported_controller(folder)
    assert model is not None
    (step,) = [s for s in online_host_checks(model) if s.name == "drawn numbers"]
    found = step.result(tmp_path / "drawn")
    assert any("solved though the residual" in line for line in found.findings), found


FAULTS = {
    "a disturbance that is no number": (
        "plant_mpc.c",
        "finite &= all_finite(&in->d, 1);",
        "",
        "golden solves",
        "the self-test of plant_mpc returned",
    ),
    "a reference that is no number": (
        "plant_mpc.c",
        "finite &= all_finite(&in->r, 1);",
        "",
        "golden solves",
        "the self-test of plant_mpc returned",
    ),
    "a feedback that does not look": (
        "plant_mpc.c",
        "moved[i] = in->",
        "moved[i] = 0 * in->",
        "golden solves",
        "the self-test of plant_mpc returned",
    ),
    "values of what was known before": (
        "plant_mpc.c",
        "if (given[i] != c->given[k][i]) {",
        "if (0) {",
        "golden solves",
        "the self-test of plant_mpc returned",
    ),
    "a reset with no number": (
        "plant_mpc.c",
        "u[i] * 0 == 0 ? u[i] : RESTING[i];",
        "u[i];",
        "golden solves",
        "the self-test of plant_mpc returned",
    ),
    "a plan that is prepared twice": (
        "plant_mpc.c",
        "c->ready != READY || c->is_prepared",
        "c->ready != READY",
        "golden solves",
        "the self-test of plant_mpc returned",
    ),
    "an input of the filter that is no number": (
        "plant_ekf.c",
        "finite &= all_finite(&in->d, 1);",
        "",
        "golden solves",
        "the self-test of plant_ekf returned",
    ),
    "a status of an update": (
        "plant_ekf.c",
        "corrected != PLANT_EKF_FILTERED ? corrected : predicted;",
        "predicted;",
        "golden solves",
        "the self-test of plant_ekf returned",
    ),
    "an innovation of nothing": (
        "plant_ekf.c",
        "out->innovation[i] = NAN;",
        "out->innovation[i] = 0;",
        "golden solves",
        "the self-test of plant_ekf returned",
    ),
    "another rounding": (
        "plant_ekf.c",
        "sum += f * v;",
        "sum += f * v * 1.0000001f;",
        "golden solves",
        "the self-test of plant_ekf returned 0x00000004",
    ),
    "a control beyond its limit": (
        "plant_mpc.c",
        "        out->u[i] = c->applied[i];\n",
        "        out->u[i] = c->applied[i] * 1.01f;\n",
        "drawn numbers",
        "error: a control",
    ),
    "NaN that is taken for solved": (
        "plant_mpc.c",
        "if (c->residual <= TOLERANCE) {",
        "if (!(c->residual > 10 * TOLERANCE)) {",
        "drawn numbers",
        "error: solved though the residual is above the tolerance",
    ),
    "a write behind the struct": (
        "plant_ekf.c",
        "    return commit(e);",
        "    ((unsigned char *)e)[sizeof *e] = 0;\n    return commit(e);",
        "drawn numbers",
        "error: a byte outside of the structs was written",
    ),
    "a filter without its guard against divergence": (
        "plant_ekf.c",
        "    if (!finite) {\n        return PLANT_EKF_DIVERGED;",
        "    if (0) {\n        return PLANT_EKF_DIVERGED;",
        "drawn numbers",
        "error: an estimate that is not finite",
    ),
    "a filter without its guard against an infinite covariance": (
        "plant_ekf.c",
        "finite &= e->work[i][j] * 0 == 0;",
        "finite &= 1;",
        "golden solves",
        "the self-test of plant_ekf returned 0x00000008",
    ),
    "a filter that forgets what is no covariance": (
        "plant_ekf.c",
        "    if (!finite) {\n        return PLANT_EKF_DIVERGED;",
        "    if (0) {\n        return PLANT_EKF_DIVERGED;",
        "golden solves",
        "the self-test of plant_ekf returned 0x00000008",
    ),
    "an index that is too large": (
        "plant_ekf.c",
        "    for (int i = 0; i < ALL; i++) {\n        e->gain[i] /= sum;",
        "    for (int i = 0; i < ALL + 1; i++) {\n        e->gain[i] /= sum;",
        "sanitizers",
        "runtime error: index 1 out of bounds",
    ),
}


@pytest.fixture(autouse=True)
def one_level(monkeypatch: pytest.MonkeyPatch) -> None:
    """All five have their turn in `test_verify.py`; bits of other levels are looked at where
    controllers and windows are compiled.
    """
    monkeypatch.setattr("msnn.verification.host_builds.LEVELS", ("-O0",))


@pytest.mark.parametrize("name", FAULTS)
def test_faults_are_found(name: str, tmp_path: Path) -> None:
    """By the one check that is for them; the others are not run."""
    require(GCC)
    folder, finding = spoiled(tmp_path, name)
    model = read_exported_controller(folder)
    assert model is not None
    check = FAULTS[name][3]
    (step,) = [s for s in online_host_checks(model) if (s.name, s.target) == (check, "gcc")]
    found = step.result(tmp_path / "checked")
    assert found.verdict == "found"
    assert any(finding in line for line in found.findings), found


def test_a_fault_ends_the_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    require(GCC, CLANG)
    monkeypatch.setattr("msnn.verification.host_builds.LEVELS", ("-O1",))
    folder, finding = spoiled(tmp_path, "another rounding")
    code, said = verified(capsys, folder)
    assert code == 1
    for compiler in ("gcc", "clang"):
        assert any(finding in line for line in said["golden solves", compiler]["findings"])


def spoiled(folder: Path, name: str) -> tuple[Path, str]:
    """An export with a fault, and what shall be said of it."""
    file, before, after, _, finding = FAULTS[name]
    # a filter alone is compiled in a quarter of the time
    export = exported(folder, FILTER if file == "plant_ekf.c" else PLANT)
    source = export / "src" / file
    text = source.read_text(encoding="utf-8")
    assert text.count(before) >= 1, name
    source.write_text(text.replace(before, after, 1), encoding="utf-8")
    return export, finding

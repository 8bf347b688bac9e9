"""What the proof says: of which inputs and states, in which order, and what is not proved."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

from msnn.cli.application import run
from msnn.verification.exported_c import read_exported_c
from msnn.verification.fuzz import run_fuzzer
from msnn.verification.proof.eva import Alarm, Analysis, PossibleValues, roots_first
from msnn.verification.proof.proof import proof_checks
from msnn.verification.proof_step import FRAMA_C, ProofStep, Result, run_tool
from tests.conditions import miss

LEAKS = """
msnn: 1
name: leaks
sample_time: 1 s
inputs:
  u: {range: [-1, 1], on_invalid: clamp}
  h: {range: [0, 2], on_invalid: hold}
states:
  kept: {next: 0.5 * kept + 0.5 * u, init: 0, range: [-2, 2]}
  grown: {next: grown + h, init: 0, range: [0, 10]}
outputs:
  y: kept + grown
"""

VECTOR = """
msnn: 1
name: leaks
sample_time: 1 s
dims: {j: 3}
constants: {c: {value: [0.5, 0.5, 2], dims: j}}
inputs: {u: {range: [-1, 1]}, v: {}}
states: {s: {next: c * s, dims: j, init: 0, range: [-1, 1]}}
outputs: {y: s, z: "sum(u[t-9:t]) + v"}
export:
  c: {ring: double}
"""

POLE = """
msnn: 1
name: leaks
sample_time: 1 s
inputs: {u: {range: [-1, 1], on_invalid: clamp}}
outputs: {y: 1 / (1.25 - u)}
"""

HOT = """
msnn: 1
name: leaks
sample_time: 1 s
inputs:
  u: {range: [-REACH, REACH]}
outputs:
  y: cosh(u) * cosh(u)
export:
  c: {dtype: DTYPE}
"""

SATURATED = """
msnn: 1
name: sums
sample_time: 1 s
inputs:
  u: {range: [-1, 1], on_invalid: clamp}
states:
  i: {next: i + 0.1 * u, init: 0, range: [-1, 1], on_range: saturate}
outputs:
  y: 2 * i
export:
  c: {dtype: DTYPE}
"""

CODE = """\
void step(void)
{
    /* a comment with = and ; */
    const float first = x / z;
    const float plain = 2.0f * x;
    const float second = first
        * 3.0f;
    s->third = second + plain;
    const float other = plain / z;
}
"""


def verified(
    spec: str, folder: Path, capsys: pytest.CaptureFixture[str], *options: str
) -> tuple[int, dict[str, Any]]:
    if not FRAMA_C.is_there:
        miss(f"frama-c is not installed: apt-get install {FRAMA_C.package}")
    path = folder / "leaks.msnn.yaml"
    path.write_text(spec, encoding="utf-8")
    words = ["export", str(path), "--initial", "--to", "c", "--out", str(folder), *options]
    assert run(words) == 0
    capsys.readouterr()
    code = run(["verify", str(folder / "c"), "--targets", "", "--proof", "--format", "json"])
    return code, json.loads(capsys.readouterr().out)


def test_the_report_says_which_states_stay_in_their_range(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, said = verified(LEAKS, tmp_path, capsys, "--with", "jacobian")
    assert code == 0, said
    files, step, linearize = said["results"]
    assert (files["check"], files["verdict"]) == ("files", "ok")
    assert (step["target"], linearize["target"]) == ("step", "linearize")
    assert "inductive: yes: kept stays in -2 .. 2" in step["notes"]
    assert "inductive: no: a step takes grown from 0 .. 10 to 0 .. 12" in step["notes"]
    assert "inductive: yes: h_held stays in 0 .. 2" in step["notes"]
    assert "2 of 3 states stay in the range assumed" in step["detail"]
    assert "any number and infinities taken at u, h" in step["notes"]


@pytest.mark.parametrize(("beyond", "end"), [("x > high", "high"), ("x < low", "low")])
def test_inputs_that_are_clamped_are_drawn_from_all_numbers(
    beyond: str, end: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    verified(LEAKS, tmp_path, capsys)
    source = tmp_path / "c" / "src" / "leaks.c"
    text = source.read_text(encoding="utf-8")
    assert f"if ({beyond}) {{\n        result = {end};" in text
    source.write_text(text.replace(f"result = {end};", "result = x;"), encoding="utf-8")
    assert run(["verify", str(tmp_path / "c"), "--targets", "", "--proof"]) == 1
    assert "kept may be NaN or infinite after a step" in capsys.readouterr().out


def test_inputs_just_beyond_their_range_are_drawn(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, said = verified(POLE, tmp_path, capsys)
    assert code == 0, said
    source = tmp_path / "c" / "src" / "leaks.c"
    text, limit = source.read_text(encoding="utf-8"), "<= 1.0f"
    assert text.count(limit) == 1
    # values up to 1.5 are no longer clamped: 1.25 is the pole
    source.write_text(text.replace(limit, "<= 1.5f"), encoding="utf-8")
    assert run(["verify", str(tmp_path / "c"), "--targets", "", "--proof"]) == 1


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_a_state_that_saturates_is_compared_with_infinity_without_an_alarm(
    dtype: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spec = SATURATED.replace("DTYPE", dtype)
    code, said = verified(spec, tmp_path, capsys)
    assert "INFINITY" in (tmp_path / "c" / "src" / "sums.c").read_text(encoding="utf-8")
    assert code == 0, said
    _, step = said["results"]
    assert "inductive: yes: i stays in -1 .. 1" in step["notes"]


def test_every_element_of_a_state_is_looked_at(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, said = verified(VECTOR, tmp_path, capsys)
    assert code == 0, said
    _, step = said["results"]
    assert "inductive: no: a step takes s from -1 .. 1 to -2 .. 2" in step["notes"]
    assert "assumed |v| <= 1e+06: the spec has no range" in step["notes"]


def test_heads_of_rings_are_any_bits(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    verified(VECTOR, tmp_path, capsys)
    source = tmp_path / "c" / "src" / "leaks.c"
    text, guard = source.read_text(encoding="utf-8"), "(s->u_history_head < 10U)"
    assert guard in text
    # a comparison with a sign lets through what is 2^31 or more
    signed = text.replace(guard, "((int32_t)s->u_history_head < 10)")
    source.write_text(signed, encoding="utf-8")
    assert run(["verify", str(tmp_path / "c"), "--targets", "", "--proof"]) == 1
    said = capsys.readouterr().out
    # where a sample and its copy are written: every alarm is counted
    assert "out of bounds index" in said
    assert "2 alarms" in said


@pytest.mark.parametrize(
    ("dtype", "inside", "outside"), [("float32", 45, 46), ("float64", 355, 356)]
)
def test_a_product_that_overflows_is_found_just_where_it_does(
    dtype: str, inside: int, outside: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """cosh(x)² is e²ˣ/4 but for 1: it passes 3.4e38 at x = 45.05, and 1.8e308 at 355.58."""
    for reach, code in ((inside, 0), (outside, 1)):
        folder = tmp_path / str(reach)
        folder.mkdir()
        spec = HOT.replace("REACH", str(reach)).replace("DTYPE", dtype)
        found, said = verified(spec, folder, capsys)
        assert found == code, said


Shown = dict[str, PossibleValues | None]

ASSUMED = {
    "kept": PossibleValues(-2.0, 2.0, nan=False),
    "grown": PossibleValues(0.0, 10.0, nan=False),
    "h_held": PossibleValues(0.0, 2.0, nan=False),
}
USUAL: Shown = {
    "result_y": PossibleValues(-5.0, 5.0, nan=False),
    **{f"begun_{name}": values for name, values in ASSUMED.items()},
    **{f"left_{name}": values for name, values in ASSUMED.items()},
}


def said_of(folder: Path, patch: pytest.MonkeyPatch, *analyses: Shown) -> Result:
    """The report of a step of LEAKS that stays where it began, but for what each analysis shows."""
    path = folder / "leaks.msnn.yaml"
    path.write_text(LEAKS, encoding="utf-8")
    assert run(["export", str(path), "--initial", "--to", "c", "--out", str(folder)]) == 0
    shown = iter(analyses)

    def analysed(*_: object, **__: object) -> Analysis:
        found = {**USUAL, **next(shown)}
        return Analysis((), {name: values for name, values in found.items() if values is not None})

    patch.setattr(f"{proof_checks.__module__}.analysed", analysed)
    (step,) = proof_checks(read_exported_c(folder / "c"))
    return step.run(folder)


def values(low: float, high: float) -> PossibleValues:
    return PossibleValues(low, high, nan=False)


@pytest.mark.parametrize(
    ("finite", "infinite", "expected"),
    [
        ({}, {}, "yes: kept stays in -2 .. 2"),
        ({"left_kept": values(-2.0, 2.5)}, {}, "no: a step takes kept from -2 .. 2 to -2 .. 2.5"),
        # of two analyses the wider one holds, whichever it is
        ({}, {"left_kept": values(-3.0, 1.0)}, "no: a step takes kept from -2 .. 2 to -3 .. 2"),
        ({"begun_kept": values(0.0, 3.0)}, {}, "no: init sets kept to -2 .. 3, not in -2 .. 2"),
        ({}, {"begun_kept": values(-3.0, 0.0)}, "no: init sets kept to -3 .. 2, not in -2 .. 2"),
    ],
)
def test_a_state_stays_where_both_analyses_say_so(
    finite: Shown, infinite: Shown, expected: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = said_of(tmp_path, monkeypatch, finite, infinite)
    assert (found.verdict, found.findings) == ("ok", ())
    assert f"inductive: {expected}" in found.notes
    assert "proved y in -5 .. 5" in found.notes


def test_a_state_that_may_be_nan_does_not_stay_in_its_range(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    left = PossibleValues(-2.0, 2.0, nan=True)
    found = said_of(tmp_path, monkeypatch, {"left_kept": left}, {})
    assert found.findings == ("kept may be NaN or infinite after a step: -2 .. 2 or NaN",)
    assert "inductive: no: a step takes kept from -2 .. 2 to -2 .. 2 or NaN" in found.notes


@pytest.mark.parametrize(
    ("shown", "expected"),
    [
        ({"result_y": values(-math.inf, 5.0)}, "y may be NaN or infinite: -inf .. 5"),
        (
            {"result_y": PossibleValues(0.0, 1.0, nan=True)},
            "y may be NaN or infinite: -5 .. 5 or NaN",
        ),
        (
            {"left_h_held": values(0.0, math.inf)},
            "h_held may be NaN or infinite after a step: 0 .. inf",
        ),
        # what never came to where values are shown proves nothing
        ({"left_grown": None}, "no call comes to its end"),
    ],
)
@pytest.mark.parametrize("first", [True, False])
def test_what_one_analysis_alone_leaves_open_is_found(
    shown: Shown, expected: str, first: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = said_of(tmp_path, monkeypatch, *((shown, {}) if first else ({}, shown)))
    assert found.verdict == "found"
    assert found.findings == (expected,)


def test_constant_time_is_named_as_not_proved(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spec = LEAKS + "export:\n  c: {constant_time: true}\n"
    code, said = verified(spec, tmp_path, capsys)
    assert code == 5
    _, result = said["results"]
    assert result["verdict"] == "not done"
    assert result["detail"].startswith("not proved: constant-time code")
    assert not said["found"]


def test_a_tool_that_does_not_end_is_not_done_and_no_finding(tmp_path: Path) -> None:
    def hang(folder: Path) -> Result:
        run_tool(["sleep", "20"], folder, 0.1)
        raise AssertionError

    result = ProofStep("proof", "step", (), hang).result(tmp_path / "here")
    assert (result.verdict, result.findings) == ("not done", ())
    assert result.detail == "no answer within 0.1 s: sleep"


def test_a_fuzzer_that_ends_before_its_runs_is_not_done(tmp_path: Path) -> None:
    def end_early(folder: Path) -> Result:
        run_fuzzer(["echo", "INFO: Seed: 1"], folder, 20.0)
        raise AssertionError

    result = ProofStep("fuzz", "clang", (), end_early).result(tmp_path / "here")
    assert (result.verdict, result.findings) == ("not done", ())
    assert result.detail == "the fuzzer ended before it had made its runs"


def test_alarms_that_follow_from_no_other_stand_first(tmp_path: Path) -> None:
    (tmp_path / "plant.c").write_text(CODE, encoding="utf-8")
    root, follows, last, other = (Alarm("plant.c", line, "assert") for line in (4, 7, 8, 9))
    found = roots_first([last, follows, root, other], tmp_path)
    assert found == [root, other, last, follows]

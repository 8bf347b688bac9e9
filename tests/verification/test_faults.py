"""Faults of generated safety code: the self-test, the fuzzer or the build's memory shows each."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from backends.c.selftest.golden_text import checksums
from msnn.cli.application import run
from msnn.verification.exported_c import read_exported_c
from msnn.verification.fuzz import FuzzerFoundError, fuzz
from msnn.verification.host_checks import writable_objects
from msnn.verification.proof_step import CLANG, GCC, LIBFUZZER, NM, Tool
from tests.conditions import miss
from tests.examples.gallery import GALLERY, spec_of

_TOLD = "{\n        status |= HEATER_STATUS_UNINITIALISED;\n    }\n    if ((s->ready"
FAULTS = {
    "hold keeps the raw sample": (
        "heater.c",
        "s->wanted_held = wanted;",
        "s->wanted_held = u->wanted;",
    ),
    "init forgets what hold falls back to": (
        "heater.c",
        "s->wanted_held = 0.0f;\n    s->ready = 7U;",
        "s->ready = 7U;",
    ),
    "reset forgets what hold falls back to": (
        "heater.c",
        "s->wanted_held = 0.0f;\n    s->ready = 4U;",
        "s->ready = 4U;",
    ),
    "reset does not say that a sample is outside": (
        "heater.c",
        "heater_flagged(x0->oven, -20.0f, 400.0f, &status);",
        "",
    ),
    "reset lets a sample pass that is a little outside": (
        "heater.c",
        "x0->duty <= 1.0f",
        "x0->duty <= 1.002f",
    ),
    "reset moves a sample to another limit": (
        "heater.c",
        "heater_clamped(x0->duty, 0.0f,",
        "heater_clamped(x0->duty, 0.001f,",
    ),
    "step does not see that one state is NaN": (
        "heater.c",
        "!(fabsf(s->error_sum) <= 500.0f)",
        "fabsf(s->error_sum) > 500.0f",
    ),
    "get_outputs forgets an output": ("heater.c", "v[HEATER_Y_OVEN_NEXT] = y->oven_next;", ""),
    "set_state forgets a state": ("heater.c", "s->oven = v[HEATER_X_OVEN];", ""),
    "set_state does not end the waiting": ("heater.c", "s->ready = 4U;", ""),
    # of all that says whether the start is over, 0 alone is told by nothing else
    "an instance of zeros is linearized": ("heater.c", "s->ready != 4U", "(s->ready & 3U) != 0U"),
    "an instance of zeros is stepped": (
        "heater.c",
        f"if (s->ready != 4U) {_TOLD}",
        f"if ((s->ready & 3U) != 0U) {_TOLD}",
    ),
    "get_state copies another state": (
        "heater.c",
        "v[HEATER_X_OVEN] = s->oven;",
        "v[HEATER_X_OVEN] = s->error_sum;",
    ),
    "get_inputs mixes inputs up": (
        "heater.c",
        "v[HEATER_U_DUTY] = u->duty;",
        "v[HEATER_U_DUTY] = u->wanted;",
    ),
    "get_outputs mixes outputs up": (
        "heater.c",
        "v[HEATER_Y_ASKED] = y->asked;",
        "v[HEATER_Y_ASKED] = y->oven_next;",
    ),
    "the sample time is another": (
        "heater_about.c",
        "heater_sample_time = 0.5f",
        "heater_sample_time = 0.50000006f",
    ),
    "a zero of the Jacobian is not written": ("heater.c", "jac->A[i] = 0.0f;", ";"),
    "a kernel's constant has another last digit": (
        "heater_math.c",
        "0x1.62e4p-1f",
        "0x1.62e402p-1f",
    ),
}


@pytest.fixture(scope="module")
def heater(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if not GCC.is_there:
        miss(f"gcc is not installed: apt-get install {GCC.package}")
    out = tmp_path_factory.mktemp("heater")
    spec = str(spec_of(GALLERY, "heater"))
    words = ["export", spec, "--initial", "--to", "c", "--with", "jacobian", "--out", str(out)]
    assert run(words) == 0
    return out / "c"


def outcome(sources: list[Path], export: Path, folder: Path) -> int:
    """What the test program of these sources returns; of the export's own only once compiled."""
    objects = [_compiled(path, export, folder) for path in sources]
    objects += [_compiled(path, export, folder) for path in sorted((export / "test").glob("*.c"))]
    program = folder / "program"
    subprocess.run(["gcc", *objects, "-o", program, "-lm"], check=True)
    return subprocess.run([program], capture_output=True, check=False).returncode


def _compiled(source: Path, export: Path, folder: Path) -> Path:
    own = source.is_relative_to(export)
    object = source.with_suffix(".o") if own else folder / f"{source.stem}.o"
    if not (own and object.is_file()):
        flags = ["-std=c99", "-O0", "-w", "-ffp-contract=off"]
        includes = [f"-I{export / part}" for part in ("include", "src", "test")]
        subprocess.run(["gcc", *flags, *includes, "-c", source, "-o", object], check=True)
    return object


def changed(export: Path, file: str, old: str, new: str, folder: Path) -> list[Path]:
    """The sources of the export, one of them changed in the last place that fits."""
    sources = sorted((export / "src").glob("*.c"))
    text = (export / "src" / file).read_text(encoding="utf-8")
    assert old in text, old
    before, _, after = text.rpartition(old)
    copy = folder / file
    copy.write_text(before + new + after, encoding="utf-8")
    return [copy if path.name == file else path for path in sources]


def test_the_right_code_passes(heater: Path, tmp_path: Path) -> None:
    assert outcome(sorted((heater / "src").glob("*.c")), heater, tmp_path) == 0


@pytest.mark.parametrize("fault", FAULTS)
def test_the_test_program_sees(fault: str, heater: Path, tmp_path: Path) -> None:
    assert outcome(changed(heater, *FAULTS[fault], tmp_path), heater, tmp_path) != 0


def test_two_instances_show_a_state_that_they_share(heater: Path, tmp_path: Path) -> None:
    text = (heater / "src" / "heater.c").read_text(encoding="utf-8")
    shared = "static heater_state_t shared;\n"
    first = text.index("/* Initialises the state without history. */")
    copy = tmp_path / "heater.c"
    text = text[:first] + shared + text[first:].replace("s->error_sum", "shared.error_sum")
    copy.write_text(text, encoding="utf-8")
    sources = [copy, *(p for p in (heater / "src").glob("*.c") if p.name != "heater.c")]
    assert outcome(sources, heater, tmp_path) != 0


PAIR = """\
msnn: 1
name: pair
sample_time: 1 s
dims: {side: 2}
inputs: {u: {dims: side, range: [-1, 1], on_invalid: clamp}}
states:
  x: {dims: side, next: 0.9 * x + u, init: 0, range: [-20, 20]}
  z: {dims: side, next: 0.8 * z + u, init: 0, range: [-5, 5], on_range: reset}
outputs: {y: x + z}
"""


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Path:
    _require(GCC)
    out = tmp_path_factory.mktemp("pair")
    spec = out / "pair.msnn.yaml"
    spec.write_text(PAIR, encoding="utf-8")
    assert run(["export", str(spec), "--initial", "--to", "c", "--out", str(out)]) == 0
    return out / "c"


@pytest.mark.parametrize("element", ["x[0U]) <= 20", "x[1U]) <= 20", "z[0U]) <= 5", "z[1U]) <= 5"])
def test_each_element_of_a_state_shows_that_it_is_nan(
    element: str, pair: Path, tmp_path: Path
) -> None:
    old, new = f"!(fabsf(s->{element}.0f)", f"fabsf(s->{element.replace('<=', '>')}.0f"
    assert outcome(changed(pair, "pair.c", old, new, tmp_path), pair, tmp_path) != 0


def test_memory_beside_the_structs_is_found(heater: Path, tmp_path: Path) -> None:
    if not NM.is_there:
        miss(f"nm is not installed: apt-get install {NM.package}")
    source = tmp_path / "model.c"
    source.write_text("int f(int x) { static int last; last = x; return last; }\n", "utf-8")
    (found,) = writable_objects([source], [], tmp_path)
    assert found.startswith("model.c: last")
    model = read_exported_c(heater)
    assert not writable_objects(model.model_sources, [f"-I{model.include}"], tmp_path)


def _fuzzed(export: Path, folder: Path) -> None:
    for tool in (CLANG, LIBFUZZER):
        _require(tool)
    fuzz(read_exported_c(export), folder, "-runs=20000", 100.0)


def _require(tool: Tool) -> None:
    if not tool.is_there:
        miss(f"{tool.command} is not installed: apt-get install {tool.package}")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("s->wanted_held = wanted;", "s->wanted_held = u->wanted;", "depends on what an invalid"),
        ("y->asked = ", "y->asked = (1.0f / (float)(s->ready & 3U)) + ", "is not finite"),
    ],
)
def test_the_fuzzer_judges_policies(
    old: str, new: str, said: str, heater: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "export"
    shutil.copytree(heater, folder)
    source = folder / "src" / "heater.c"
    text = source.read_text(encoding="utf-8")
    assert old in text
    source.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(FuzzerFoundError) as caught:
        _fuzzed(folder, tmp_path)
    assert any(said in line for line in caught.value.lines)


@pytest.mark.parametrize("changed", [2, 3, 24])
def test_slopes_with_the_other_sign_have_another_checksum(changed: int) -> None:
    """Of two changed signs one must not hide the other, as in a product of words modulo 2^32."""
    right = np.random.default_rng(0).normal(size=(5, 4, 25)).astype(np.float32)
    wrong = right.reshape(5, 100).copy()
    wrong[:, :changed] *= -1.0
    pairs = zip(checksums({"A": right}), checksums({"A": wrong.reshape(5, 4, 25)}), strict=True)
    assert all(a != b for a, b in pairs)

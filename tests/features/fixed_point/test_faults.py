"""Faults of generated fixed-point code: the test program shows each."""

import shutil
import subprocess
from pathlib import Path

import pytest

from msnn.exports.export import write_export
from tests.conditions import require_tool
from tests.features.fixed_point.exported import fixed_model, planned

SPEC = """\
msnn: 1
name: model
sample_time: 10 ms
dims: {h: 2}
inputs:
  u: {range: [-2, 2], on_invalid: hold}
  w: {range: [-1, 1], on_invalid: clamp}
parameters: {a: {dims: h, init: "[0.4, -1.2]"}}
layers:
  f: {fir: {window: 5, init: "0.25 - 0.1 * i"}}
  table: {interpolation: {x: [-2, -1, 0, 1, 2], y: [-1, -0.8, 0, 0.5, 1]}}
states:
  x: {next: "0.95 * x + 0.05 * tanh(f(u)) + 0.02 * w[t-2]", init: 0.1, range: [-3, 3]}
  y: {next: "0.9 * y + where(x > 0.2, 0.1 * table(u), -0.05 * w)", init: 0, range: [-4, 4]}
  count: {next: "count + 0.5 * u", init: 1, range: [-9, 7], on_range: reset}
outputs: {x_next: next(x), y_now: y, counted: count, n: "sum(tanh(a * x))"}
"""

FAULTS = {
    "hold keeps the raw word": ("s->u_held = w_u;", "s->u_held = u->u;"),
    "hold forgets a word of 0": ("s->u_held = w_u;", "if (w_u != 0) { s->u_held = w_u; }"),
    "hold falls back to the past": ("w_u = s->u_held;", "w_u = s->u_history[3U];"),
    "init forgets what hold falls back to": ("s->u_held = (model_word_t)0;", ""),
    "reset keeps a raw word of the past": (
        "s->u_history[2U] = w_u[2U];",
        "s->u_history[2U] = x0->u[2U];",
    ),
    "a threshold counts as beyond": ("(s->x > 26843546)", "(s->x >= 26843546)"),
    "a threshold is the next number": ("(s->x > 26843546)", "(s->x > 26843547)"),
    "a threshold is a little higher": ("(s->x > 26843546)", "(s->x > 26844000)"),
    "a limit of a kink is another": ("< 8192) ? n39 : 8192", "< 8191) ? n39 : 8191"),
    "a state loses its last bit": ("s->y = n", "s->y = ~1 & n"),
    "a state starts again elsewhere": ("s->count = 33554432;\n    }", "s->count = 0;\n    }"),
    "a state may be a little beyond": ("-301989888, 234881024)", "-301989888, 234881025)"),
}


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    require_tool("gcc", "apt-get install gcc")
    folder = tmp_path_factory.mktemp("model")
    write_export(planned(fixed_model(folder, SPEC, "q15")), {}, folder / "c")
    return folder / "c"


def _outcome(export: Path, folder: Path) -> int:
    sources = [*(export / "src").glob("*.c"), export / "test" / "model_sil.c"]
    command = ["gcc", "-std=c99", "-O0", "-w", "-I", str(export / "include"), *map(str, sources)]
    subprocess.run([*command, "-o", str(folder / "program")], check=True)
    return subprocess.run([folder / "program"], capture_output=True, check=False).returncode


def test_the_right_code_passes(exported: Path, tmp_path: Path) -> None:
    assert _outcome(exported, tmp_path) == 0


@pytest.mark.parametrize("fault", FAULTS)
def test_the_test_program_sees(fault: str, exported: Path, tmp_path: Path) -> None:
    shutil.copytree(exported, tmp_path / "c")
    source = tmp_path / "c" / "src" / "model.c"
    text = source.read_text(encoding="utf-8")
    old, new = FAULTS[fault]
    assert old in text
    before, _, after = text.rpartition(old)
    source.write_text(before + new + after, encoding="utf-8")
    assert _outcome(tmp_path / "c", tmp_path) != 0


COARSE = """\
msnn: 1
name: model
sample_time: 10 ms
inputs: {u: {range: [-2, 2], on_invalid: hold}, w: {range: [-2, 2]}}
outputs: {y: 0.001 * u + w}
"""


def test_what_reset_forgets_is_seen_where_a_word_of_minus_1_rounds_to_0(tmp_path: Path) -> None:
    """What memory held before is no such word."""
    require_tool("gcc", "apt-get install gcc")
    write_export(planned(fixed_model(tmp_path, COARSE, "q15")), {}, tmp_path / "c")
    assert _outcome(tmp_path / "c", tmp_path) == 0
    source = tmp_path / "c" / "src" / "model.c"
    text = source.read_text(encoding="utf-8")
    # `init` has the same line before it
    before, forgotten, after = text.rpartition("s->u_held = (model_word_t)0;")
    assert forgotten
    source.write_text(before + after, encoding="utf-8")
    assert _outcome(tmp_path / "c", tmp_path) != 0

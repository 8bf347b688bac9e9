"""The written folder: the same bytes each time, readable C, and nothing that a name can break."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from backends.c import COptions, write_c
from backends.c_language.rendering import WIDTH, comment_text, string_literal
from compiler.passes.to_step_form import to_step_form
from tests.backends.c.c_programs import (
    assert_same_bits,
    built,
    closed_sample,
    golden,
    replay,
)
from tests.backends.c.small_programs import HOSTILE, hostile
from tests.conditions import require_tool
from tests.golden import assert_golden, without_identity
from tests.programs import SAMPLES

GOLDEN = Path(__file__).parent.parent.parent / "golden"


@pytest.mark.parametrize("name", ["fir_closed_loop", "spring_damper_rk4", "joint_arm"])
def test_the_code_is_as_it_was_read(name: str, accept: bool, tmp_path: Path) -> None:
    write_c(closed_sample(name), {}, tmp_path, COptions())
    for path in (f"include/{name}.h", f"src/{name}.c", f"src/{name}_params.c"):
        text = without_identity((tmp_path / path).read_text())
        assert_golden(GOLDEN / f"c_{name}" / Path(path).name, text, accept)


@pytest.mark.parametrize("name", SAMPLES)
def test_writing_again_gives_the_same_bytes(name: str, tmp_path: Path) -> None:
    paths = write_c(closed_sample(name), {}, tmp_path / "one")
    again = write_c(closed_sample(name), {}, tmp_path / "two")
    assert [p.read_bytes() for p in paths] == [p.read_bytes() for p in again]
    assert sorted(paths) == sorted(p for p in (tmp_path / "one").rglob("*") if p.is_file())


@pytest.mark.parametrize("name", SAMPLES)
def test_lines_can_be_read(name: str, tmp_path: Path) -> None:
    for path in write_c(closed_sample(name), {}, tmp_path):
        if path.suffix in {".c", ".h"} and "_math" not in path.name:
            lines = path.read_text(encoding="ascii").split("\n")
            assert max(map(len, lines)) <= WIDTH
            assert not any(line.endswith(" ") for line in lines)


def test_hostile_names_and_documents_stay_text(tmp_path: Path) -> None:
    program = hostile()
    for params in ("const", "inline"):
        options = COptions(params=params, prefix="*/ evil")
        folder = tmp_path / params
        vectors = golden(program, options, 50, seed=1)
        write_c(program, {}, folder, options)
        step = built(program, folder, options, flags=("-O1", "-Wall", "-Wextra", "-Werror"))
        outputs, _ = replay(step, vectors)
        assert set(outputs) == set(HOSTILE)
        assert_same_bits(outputs, vectors.outputs)
        for path in folder.rglob("*.[ch]"):
            text = path.read_text(encoding="ascii")
            assert "#error out" not in text
            assert "??" not in text
        assert (folder / "include" / "evil.h").is_file()


@pytest.mark.parametrize("text", [*HOSTILE, "**//", "/*/", "*?/?/", "\\*/", "a" * 300, "*" * 300])
def test_a_comment_cannot_be_left(text: str) -> None:
    safe = comment_text(text)
    framed = f"/* {safe} */"
    assert framed.find("*/") == len(framed) - 2
    assert "/*" not in framed[2:]
    assert safe.isascii()
    assert safe.isprintable()
    assert "\\" not in safe


def test_a_string_literal_holds_its_text() -> None:
    assert string_literal('a"b\\n ?? ρ') == '"a\\"b\\\\n \\?\\? rho"'


def test_the_layout_names_every_field(tmp_path: Path) -> None:
    program = closed_sample("preview_driver")
    write_c(program, {}, tmp_path)
    data = json.loads((tmp_path / "preview_driver.json").read_text(encoding="utf-8"))
    assert [f["field"] for f in data["c"]["structs"]["in"]] == ["road"]
    assert data["c"]["structs"]["in"][0]["shape"] == [4]
    assert [port["port"] for port in data["inputs"]] == ["road"]


def test_given_weights_are_the_defaults(tmp_path: Path) -> None:
    program = closed_sample("spring_damper_rk4")
    step = built(program, tmp_path, COptions(dtype="float64"), weights={"stiffness": 3.25})
    step.reset({"x.meas": 2.0})
    assert step.step({"F": 0.0})[0]["spring_force"] == 6.5
    with pytest.raises(ValueError, match="shape"):
        write_c(program, {"stiffness": np.zeros(2)}, tmp_path)


def test_window_form_is_refused(tmp_path: Path) -> None:
    sample = SAMPLES["preview_driver"]()
    with pytest.raises(ValueError, match="step form"):
        write_c(sample.program, {}, tmp_path)
    assert not list(tmp_path.iterdir())
    write_c(to_step_form(sample.program), {}, tmp_path)


def test_the_code_can_be_called_from_python_alone(tmp_path: Path) -> None:
    program = closed_sample("preview_driver")
    vectors = golden(program, COptions(), 20, seed=3)
    built(program, tmp_path, COptions())
    calls = {
        "reset": {name: value.tolist() for name, value in vectors.start.windows.items()},
        "steps": [{"road": row.tolist()} for row in vectors.inputs["road"][:-1]],
    }
    script = """
import json, sys
from preview_driver_ffi import Model
calls = json.loads(sys.argv[1])
model = Model("./lib0.so")
model.reset(calls["reset"])
print(json.dumps([model.step(inputs) for inputs in calls["steps"]]))
print(model.selftest())
"""
    done = subprocess.run(
        [sys.executable, "-S", "-c", script, json.dumps(calls)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    steps, selftest = done.stdout.splitlines()
    for k, (outputs, status) in enumerate(json.loads(steps)):
        assert outputs == {name: float(vectors.outputs[name][k]) for name in outputs}
        assert status == vectors.status[k]
    assert selftest == "0"


def test_many_steps_run_from_python_in_one_call(tmp_path: Path) -> None:
    require_tool("cc", install="apt install gcc")
    program = closed_sample("preview_driver")
    vectors = golden(program, COptions(), 20, seed=3)
    write_c(program, {}, tmp_path)
    windows = json.dumps({name: value.tolist() for name, value in vectors.start.windows.items()})
    np.save(tmp_path / "road.npy", vectors.inputs["road"])
    script = """
import json, sys
import numpy as np
from preview_driver_ffi import Model, build
model = Model(build())
model.reset(json.loads(sys.argv[1]))
outputs, status = model.run({"road": np.load("road.npy")})
np.savez("found.npz", status=status, **outputs)
"""
    subprocess.run([sys.executable, "-c", script, windows], cwd=tmp_path, check=True)
    found = np.load(tmp_path / "found.npz")
    assert np.array_equal(found["status"], vectors.status)
    for name, values in vectors.outputs.items():
        assert found[name].dtype == np.float32
        assert np.array_equal(found[name], values, equal_nan=True)


@pytest.mark.parametrize("name", SAMPLES)
def test_the_readme_does_what_it_says(name: str, tmp_path: Path) -> None:
    write_c(closed_sample(name), {}, tmp_path)
    text = (tmp_path / "README.md").read_text(encoding="utf-8")
    (tmp_path / "main.c").write_text(text.split("```c\n")[1].split("```")[0])
    command = next(line for line in text.splitlines() if line.startswith("    cc ")).split()
    subprocess.run(["gcc", *command[1:], "-Wall", "-Werror"], cwd=tmp_path, check=True)
    done = subprocess.run(
        [str(tmp_path / "a.out")], capture_output=True, text=True, check=True, cwd=tmp_path
    )
    reset, *steps = done.stdout.splitlines()
    assert reset == "reset 0"
    assert len(steps) == 10
    assert all(line.startswith("status 0 ") for line in steps)


def test_numbers_beyond_float32_are_infinite(tmp_path: Path) -> None:
    program = closed_sample("spring_damper_rk4")
    write_c(program, {"mass": 1e300}, tmp_path)
    assert "INFINITY" in (tmp_path / "src" / "spring_damper_rk4_params.c").read_text()


def test_cmake_builds_and_tests_the_folder(tmp_path: Path) -> None:
    cmake = require_tool("cmake", install="apt install cmake")
    require_tool("make", install="apt install make")
    write_c(closed_sample("fuzzy_local_models"), {}, tmp_path)
    build = tmp_path / "build"
    for command in (
        [cmake, "-S", str(tmp_path), "-B", str(build)],
        [cmake, "--build", str(build)],
        [str(build / "fuzzy_local_models_sil")],
    ):
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
    assert "agree" in done.stdout

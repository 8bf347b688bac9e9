"""A node of ROS 2 compiles against stubs of what it calls, and steps as the C beside it does."""

from __future__ import annotations

import subprocess
from pathlib import Path
from textwrap import dedent
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.typing import NDArray

from backends.c.host.build import build_library
from msnn.agreement.judgement import drawn_record
from msnn.exports.export import load_export, plan_exports, write_export
from msnn.exports.target import AnyPlan, Written
from msnn.model.load import load_model
from msnn.model.weights.weights_file import initial_weights
from spec_schema.diagnostics.diagnostic import Findings
from tests.conditions import require_tool
from tests.examples.gallery import GALLERY, NAMES, spec_of
from tests.exports.test_fmu import PLANT

STUB = Path(__file__).parent / "ros2_stub"
STRICT = ["-std=c++17", "-Wall", "-Wextra", "-Werror", "-ffp-contract=off"]
STATIC = """
msnn: 1
name: Valve__two
inputs: {a__b: {range: [-1, 1]}, a_b: {}}
parameters: {g: {init: 2, max: 5}}
outputs: {y: g * tanh(a__b) + a_b}
"""

TAKEN = """
msnn: 1
name: taken
sample_time: 1 s
inputs: {u: {}}
parameters: {use_sim_time: {init: 0.5, max: 1}}
states: {x: {next: use_sim_time * x + u, init: x.meas, range: [2, 5]}}
outputs: {y: x}
"""
"""A parameter has the name of one that each node has."""


def plan_of(spec: Path, *settings: str) -> AnyPlan:
    (plan,) = plan_exports(load_model(spec, ["export.c.with=ros2", *settings]), ["c"], Findings())
    return plan


def written(plan: AnyPlan, folder: Path) -> Written:
    return write_export(plan, initial_weights(plan.program), folder)


def saved(text: str, folder: Path) -> Path:
    path = folder / "plant.msnn.yaml"
    path.write_text(dedent(text), encoding="utf-8")
    return path


def built(files: Written, prefix: str, level: str = "-O0") -> Path:
    """The node as a program that reads messages."""
    require_tool("g++", install="apt install g++")
    folder = files.folder
    library = build_library(folder, folder / "libmodel.so", flags=("-O0",))
    program = folder / "node"
    node = folder / "ros2" / "src" / f"{prefix}_node.cpp"
    include = [f"-I{STUB}", f"-I{folder / 'include'}"]
    link = [str(library), f"-Wl,-rpath,{folder}", "-o", str(program)]
    subprocess.run(["g++", *STRICT, level, *include, str(node), *link], check=True)
    return program


def said(program: Path, lines: list[str], *arguments: str) -> list[str]:
    done = subprocess.run(
        [str(program), *arguments],
        input="\n".join(lines) + "\n",
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.splitlines()


def published(lines: list[str], topic: str) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    rows = [line.split()[1:] for line in lines if line.split()[0] == topic]
    return np.array([[float.fromhex(word) for word in row] for row in rows])


@pytest.mark.parametrize("params", ["const", "tunable", "calibration", "inline"])
def test_it_steps_as_the_c_beside_it(params: str, tmp_path: Path) -> None:
    require_tool("gcc", install="apt install gcc")
    plan = plan_of(saved(PLANT, tmp_path), f"export.c.params={params}")
    weights = initial_weights(plan.program)
    files = write_export(plan, weights, tmp_path / "out")
    # an optimiser warns of more: once, of the node that has most in it
    program = built(files, "plant", "-O2" if params == "tunable" else "-O0")
    judged = plan.target.judge(plan, weights, drawn_record(plan.program, "drawn"), "float32")
    steps = 30
    inputs = {name: values[:steps] for name, values in judged.inputs.items()}
    lines = ["tick"]
    for k in range(steps):
        for name, values in inputs.items():
            lines.append(f"~/{name} {' '.join(float(v).hex() for v in np.ravel(values[k]))}")
        lines.append("tick")
    start = [f"start.{n}:={joined(v)}" for n, v in judged.beginning.windows.items()]
    found = said(program, lines, *start)
    assert "node plant" in found
    assert "timer 100000000 ns" in found
    with load_export(plan, files) as loaded:
        expected = loaded.run(judged.beginning, inputs, steps)
    for name, values in expected.items():
        shown = published(found, f"~/{name}")  # nothing before each input was heard
        assert shown.astype(np.float32).tobytes() == values.tobytes(), name


def test_parameters_are_taken_or_refused_together(tmp_path: Path) -> None:
    plan = plan_of(saved(PLANT, tmp_path), "export.c.params=tunable")
    program = built(written(plan, tmp_path / "out"), "plant")
    inputs = ["~/torque 0 0", "~/slope 1"]
    found = said(
        program,
        [*inputs, "set k 4 9.5", "set k 4", "set T nan", "tick", "set k 4 5", "tick", "~/torque 1"],
    )
    refused = [line for line in found if line.startswith("refused ")]
    assert refused == [
        "refused k is not finite, or outside [0, 9]",
        "refused another number of values than 2",
        "refused T is not finite",
    ]
    assert "parameter k: k [1/s], 2 numbers: stiffness" in found
    first, second = published(found, "~/w_next")
    assert (first == first[0] * np.array([1, first[1] / first[0]])).all()
    expected = first * np.exp(-np.array([4.0, 5.0]) * 0.1)
    assert second == pytest.approx(expected, rel=1e-3)
    assert "warning a message has not 2 numbers and is left out" in found


def test_a_node_answers_with_the_parameters_that_it_computes_with(tmp_path: Path) -> None:
    """What a launch gives is judged as what is set: a refused value is not declared either."""
    plan = plan_of(saved(PLANT, tmp_path), "export.c.params=tunable")
    program = built(written(plan, tmp_path / "out"), "plant")
    wrong = ["k:=4,9.5", "T:=nan", "start.m:=2", "start.slope:=1,1"]
    asked = ["get k", "get T", "get start.m", "get start.slope"]
    found = said(program, asked, *wrong)
    errors = [line for line in found if line.startswith("error ")]
    end = "could not be set: {}: what was exported is used"
    assert errors == [
        f"error parameter 'k' {end.format('k is not finite, or outside [0, 9]')}",
        f"error parameter 'T' {end.format('T is not finite')}",
        f"error parameter 'start.slope' {end.format('another number of values than 3')}",
    ]
    assert [published(found, name)[0].tolist() for name in ("k", "T", "start.m")] == [
        *([2.0, 3.0], [21.5], [2.0])
    ]
    assert published(found, "start.slope").shape == (1, 3)
    found = said(program, ["get T"], "T:=")
    assert "error parameter 'T' has invalid type: what was exported is used" in found
    assert published(found, "T").tolist() == [[21.5]]
    found = said(program, ["get k", "set k 1 2", "get k", "set k 1 99", "get k"], "k:=4,5")
    assert published(found, "k").tolist() == [[4.0, 5.0], [1.0, 2.0], [1.0, 2.0]]


def test_a_model_without_memory_steps_at_each_message(tmp_path: Path) -> None:
    """Names that differ in underscores alone, which ROS does not allow to be repeated, stay two."""
    plan = plan_of(saved(STATIC, tmp_path), "export.c.params=tunable")
    files = written(plan, tmp_path / "out")
    found = said(built(files, plan.prefix), ["~/a_b 0.5", "~/a_b_2 1", "set g 6", "~/a_b 0"])
    assert "node valve_two" in found
    assert "refused g is not finite, or outside [-inf, 5]" in found
    assert published(found, "~/y").shape == (2, 1)
    root = ElementTree.parse(files.folder / "ros2" / "package.xml").getroot()  # noqa: S314
    assert root.findtext("name") == "valve_two"


def test_no_parameter_is_declared_twice(tmp_path: Path) -> None:
    """rclcpp throws where a node declares again what it has: the node would end at launch."""
    plan = plan_of(saved(TAKEN, tmp_path), "export.c.params=tunable")
    program = built(written(plan, tmp_path / "out"), "taken")
    lines = ["set use_sim_time 1", "set use_sim_time_2 2", "set use_sim_time_2 0.25", "~/u 1"]
    found = said(program, [*lines, "tick"], "start.x:=4")
    assert "refused use_sim_time_2 is not finite, or outside [-inf, 1]" in found
    assert published(found, "~/y").tolist() == [[4.0]]


def test_a_start_that_the_model_finds_wrong_is_an_error(tmp_path: Path) -> None:
    plan = plan_of(saved(TAKEN, tmp_path), "export.c.params=tunable")
    program = built(written(plan, tmp_path / "out"), "taken")
    found = said(program, ["~/u 1"], "start.x:=nan")
    assert "error what the model starts from says 18" in found  # NaN is 2, outside the range 16
    assert not [line for line in said(program, ["~/u 1"], "start.x:=4") if line.startswith("error")]


@pytest.mark.parametrize("name", NAMES)
def test_the_gallery_compiles_without_warnings(name: str, tmp_path: Path) -> None:
    require_tool("g++", install="apt install g++")
    plan = plan_of(spec_of(GALLERY, name), "export.c.params=tunable")
    files = written(plan, tmp_path)
    node = files.folder / "ros2" / "src" / f"{plan.prefix}_node.cpp"
    include = [f"-I{STUB}", f"-I{files.folder / 'include'}"]
    subprocess.run(["g++", *STRICT, *include, "-fsyntax-only", str(node)], check=True)
    text = (files.folder / "ros2" / "README.md").read_text(encoding="utf-8")
    assert "ROS could not be had" in text


def test_there_is_no_node_unless_asked_for(tmp_path: Path) -> None:
    path = saved(PLANT, tmp_path)
    (plan,) = plan_exports(load_model(path), ["c"], Findings())
    assert not [p for p in written(plan, tmp_path / "out").files if "ros2" in p.parts]


def joined(values: NDArray[np.floating]) -> str:
    return ",".join(float(value).hex() for value in np.ravel(values))

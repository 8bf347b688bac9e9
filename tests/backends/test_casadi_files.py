"""The files of a CasADi export load without msnn, describe themselves and do not vary."""

from __future__ import annotations

import json
import runpy
from importlib import metadata
from pathlib import Path
from typing import Any

import casadi
import numpy as np
import pytest

from backends.casadi_function import files
from backends.casadi_function.files import write_casadi
from backends.casadi_function.function import build_function
from compiler.ir.program import Program
from compiler.passes.to_step_form import to_step_form
from tests.backends import casadi_tools
from tests.backends.readme_code import readme_code, run_example
from tests.programs import SAMPLES


@pytest.fixture
def program() -> Program:
    return to_step_form(SAMPLES["joint_arm"]().program)


def test_writes_five_files_of_which_four_load(program: Program, tmp_path: Path):
    paths = write_casadi(program, None, tmp_path, "arm")
    names = ["arm.casadi", "arm_initial_state.casadi", "arm.json", "arm_casadi.md", "arm_casadi.py"]
    assert [path.name for path in paths] == names
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)
    loaded, built = casadi.Function.load(str(paths[0])), build_function(program)
    assert loaded.name_in() == built.name_in()
    arguments = [np.linspace(0.1, 0.9, size) for size in map(built.size1_in, range(built.n_in()))]
    for a, b in zip(loaded(*arguments), built(*arguments), strict=True):
        np.testing.assert_array_equal(np.array(a), np.array(b))


def test_the_description_names_ports_units_and_values(program: Program, tmp_path: Path):
    weights = {"coupling": np.arange(9.0).reshape(3, 3)}
    paths = write_casadi(program, weights, tmp_path, "arm")
    data = json.loads(paths[2].read_text(encoding="utf-8"))
    assert data["sample_time"] == 0.001
    assert data["functions"]["step"] == "arm.casadi"
    by_name = {entry["name"]: entry for entry in data["parameters"]}
    assert by_name["coupling"]["values"] == list(range(9))
    assert by_name["coupling"]["unit"] == "rad/N/m"
    torque = data["inputs"][1]
    assert (torque["name"], torque["unit"], torque["range"]) == ("tau", "N*m", [-5.0, 5.0])
    (history,) = data["states"]
    assert history["origin"] == {"kind": "history", "source": "q"}
    assert (history["port"], history["next_port"]) == ("q_history", "q_history_next")
    assert history["axes"] == [{"name": "joint", "size": 3}, {"name": "t", "size": 3}]
    (window,) = data["start_windows"]
    assert (window["first_sample"], window["last_sample"]) == (-3, -1)
    assert data["dimensions"][0]["labels"] == ["base", "elbow", "wrist"]


def test_a_late_input_is_described(tmp_path: Path):
    program = to_step_form(SAMPLES["late_sensor"]().program)
    data = json.loads(write_casadi(program, None, tmp_path, "p")[2].read_text(encoding="utf-8"))
    sensor = next(entry for entry in data["inputs"] if entry["name"] == "sensor")
    assert sensor["lag"] > 0
    assert sensor["last_sample"] == -sensor["lag"]


def test_the_same_program_gives_the_same_bytes(program: Program, tmp_path: Path):
    first = [path.read_bytes() for path in write_casadi(program, None, tmp_path / "a", "arm")]
    second = [path.read_bytes() for path in write_casadi(program, None, tmp_path / "b", "arm")]
    assert first == second


@pytest.mark.parametrize("name", SAMPLES)
def test_a_module_has_the_functions_for_any_version_of_casadi(name: str, tmp_path: Path):
    """The `.casadi` files are read by the version that wrote them and by later ones."""
    program = to_step_form(SAMPLES[name]().program)
    paths = write_casadi(program, None, tmp_path, "model")
    simplifies = casadi.GlobalOptions.getSimplificationOnTheFly()
    module = runpy.run_path(str(paths[4]))
    assert casadi.GlobalOptions.getSimplificationOnTheFly() == simplifies
    data = json.loads(paths[2].read_text(encoding="utf-8"))
    assert data["casadi"] == metadata.version("casadi")
    assert data["functions"]["any_version"] == "model_casadi.py"
    random = np.random.Generator(np.random.Philox(1))
    for path, function in ((paths[0], "step"), (paths[1], "initial_state")):
        saved, written = casadi.Function.load(str(path)), module[function]
        assert (written.name(), written.name_in()) == (saved.name(), saved.name_in())
        assert (written.name_out()) == (saved.name_out())
        sizes = [saved.numel_in(k) for k in range(saved.n_in())]
        for special in (0.0, 1.0, -0.5, np.inf, np.nan):
            arguments = [random.uniform(-1.5, 1.5, size) for size in sizes]
            for argument in arguments:
                argument[random.random(len(argument)) < 0.2] = special
            for a, b in zip(written.call(arguments), saved.call(arguments), strict=True):
                np.testing.assert_allclose(np.array(a), np.array(b), rtol=1e-13, atol=1e-15)


def test_a_vast_function_has_no_module(
    program: Program, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(files, "LARGEST", 10)
    paths = write_casadi(program, None, tmp_path, "arm")
    assert not (tmp_path / "arm_casadi.py").exists()
    assert "any_version" not in json.loads(paths[2].read_text(encoding="utf-8"))["functions"]
    readme = paths[3].read_text(encoding="utf-8")
    assert "which earlier versions cannot read. A port" in readme


@pytest.mark.parametrize("name", ["joint_arm", "spring_damper_rk4", "preview_driver"])
def test_the_readme_runs(name: str, tmp_path: Path):
    program = to_step_form(SAMPLES[name]().program)
    paths = write_casadi(program, None, tmp_path, "model")
    printed = run_example(paths[3])
    assert program.outputs[0].name in printed


@pytest.mark.parametrize("name", ["joint_arm", "spring_damper_rk4", "preview_driver"])
def test_the_readme_makes_models_of_do_mpc_and_acados(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """do-mpc 5.1.2 closed a loop by this text; here both are told and compared with the step."""
    casadi_tools.install(monkeypatch)
    paths = write_casadi(to_step_form(SAMPLES[name]().program), None, tmp_path, "model")
    shown: dict[str, Any] = {"__file__": str(paths[3])}
    exec(readme_code(paths[3]), shown)  # noqa: S102  (what its readers do)
    shown["decided"] = shown["ports"]["inputs"][:1]
    known = shown["ports"]["inputs"][1:]
    told, model = shown["do_mpc_model"](), shown["acados_model"]()
    assert told.is_set_up
    assert told.types == ("discrete", "MX")
    assert [list(names) for names in told.variables.values()] == [
        shown["ports"]["states"],
        shown["decided"],
        known,
    ]
    assert model.name == "model"
    x, u, known_ahead = (casadi.vertcat(*names.values()) for names in told.variables.values())
    following = casadi.vertcat(*(told.following[name] for name in shown["ports"]["states"]))
    of_do_mpc = casadi.Function("told", [x, u, known_ahead], [following])
    of_acados = casadi.Function("told", [model.x, model.u, model.p], [model.disc_dyn_expr])
    step, random = shown["step"], np.random.default_rng(0)
    values = {n: random.uniform(0.1, 0.9, step.size_in(n)) for n in shown["ports"]["states"]}
    values |= {n: random.uniform(0.1, 0.9, step.size_in(n)) for n in shown["ports"]["inputs"]}
    found = step.call({**values, **shown["parameters_of"](step)})
    expected = np.concatenate([np.array(found[after]).ravel() for after in shown["following"]])
    parts = [
        np.concatenate([np.empty(0), *(values[n].ravel() for n in names)])
        for names in (shown["ports"]["states"], shown["decided"], known)
    ]
    for function in (of_do_mpc, of_acados):
        np.testing.assert_array_equal(np.array(function(*parts)).ravel(), expected)


def test_a_weight_of_a_wrong_shape_writes_nothing(program: Program, tmp_path: Path):
    with pytest.raises(ValueError, match="coupling"):
        write_casadi(program, {"coupling": np.zeros(4)}, tmp_path, "arm")
    assert list(tmp_path.iterdir()) == []

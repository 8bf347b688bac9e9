"""The optimal control problem of a spec as data."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import msnn
from compiler.ir.program import History, Tape
from compiler.linking.renaming import Renaming
from msnn.features.control.keys import OptimalControl
from msnn.features.control.problem.horizon import stages_of
from msnn.features.control.problem.optimal_control import ControlProblem
from msnn.features.control.problem.trained import trained
from msnn.model.program_file import write_program_file
from tests.features.control.specs import DOUBLE_INTEGRATOR, load, mpc

FED_BACK = """
msnn: 1
name: fed_back
sample_time: 0.1 s
inputs:
  u: {range: [-4, 4]}
  w: {}
  y: {}
layers: {past: {fir: {window: 3, init: 0.2}}}
outputs:
  y_next: {expr: "past(y) + 0.5 * u + u[t-2] + w", predicts: "y[t+1]"}
mpc:
  horizon: 6
  controls: [u]
  cost: {stage: y**2 + u**2, terminal: y**2}
  bounds: {y: {max: 2}, y_next: {max: 3}, u: {rate: 10}}
  preview: [w]
"""


def test_signals_that_outputs_predict_are_fed_back(tmp_path: Path) -> None:
    problem = load(tmp_path, FED_BACK).of(ControlProblem)
    assert problem is not None
    kinds = {name: type(origin) for name, origin in problem.registers.items()}
    assert kinds == {"y.tape": Tape, "u.history": History}
    assert [m.name for m in problem.disturbances.members] == ["w"]
    assert problem.previewed == {"w"}
    # the tape ends with y at t, the history of u with that at t-1
    assert [m.axes[-1].size for m in problem.states.members] == [3, 2]
    assert problem.previous("u") == (4,)
    assert problem.control_limits[0].rate == pytest.approx(1.0)
    assert problem.control_limits[0].scale == 4


def test_a_limit_counts_where_the_controls_move_it(tmp_path: Path) -> None:
    problem = load(tmp_path, FED_BACK).of(ControlProblem)
    assert problem is not None
    stages = {path.name: stages_of(problem, path) for path in problem.path_limits}
    # y at t is measured; y_next at t is y at t+1, which the control at t moves
    assert stages == {"y": slice(1, 7), "y_next": slice(0, 6)}


def test_what_is_bounded_is_used(tmp_path: Path) -> None:
    text = DOUBLE_INTEGRATOR + "equations: {speed2: v**2, left: v**3}\n"
    model = load(
        tmp_path,
        text + "mpc: {horizon: 5, controls: [u], cost: p**2, bounds: {speed2: {max: 4}}}\n",
    )
    assert [found.message for found in model.warnings] == ["`left` is never used"]


def test_what_formulas_read(tmp_path: Path) -> None:
    problem = load(tmp_path, FED_BACK).of(ControlProblem)
    assert problem is not None
    assert problem.terminal is not None
    reads = problem.reads(problem.node(problem.terminal))
    assert reads.states == {"y.tape"}
    assert reads.signals == frozenset()
    assert problem.type(problem.stage).axes == ()


def test_weights_become_constants_and_soft_limits_get_theirs(tmp_path: Path) -> None:
    model = load(tmp_path, FED_BACK)
    control = model.of(ControlProblem)
    assert control is not None
    weights = msnn.initial_weights(model)
    problem = trained(control, weights | {"past.weight": np.array([1.0, 0.0, 0.0])})
    assert problem.program.parameters == ()
    for path in problem.path_limits:
        assert path.linear is not None
        assert path.quadratic is not None
        assert path.linear > 0
        assert path.quadratic == pytest.approx(path.linear / path.scale)


SOFT = """
msnn: 1
name: soft
sample_time: 1 s
inputs: {u: {between: hold, range: [-3, 3]}}
states: {x: {next: 0.5 * x + u, init: x.meas, range: [-4, 4]}}
outputs: {y: x}
mpc:
  horizon: HORIZON
  controls: [u]
  cost: {stage: "x**2 + u**2", terminal: "1e6 * x**2"}
  bounds: {x: {min: -1, max: 4}}
"""


def test_a_soft_limit_without_weights_is_steeper_than_the_cost_of_the_horizon(
    tmp_path: Path,
) -> None:
    """10 N c / s and that over s: of 4² + 3² at most, the largest of 256 draws is at least 16.

    One draw in ten is above 16.
    """
    for horizon in (3, 12):
        control = load(tmp_path, SOFT.replace("HORIZON", str(horizon))).of(ControlProblem)
        assert control is not None
        (path,) = trained(control, {}).path_limits
        assert path.scale == 2.5
        assert path.linear is not None
        assert 16 < path.linear * path.scale / (10 * horizon) <= 25
        assert path.quadratic == pytest.approx(path.linear / 2.5)


def test_a_program_file_has_its_controller_too(tmp_path: Path) -> None:
    model = load(tmp_path, DOUBLE_INTEGRATOR + mpc(bounds="{u: {min: -1, max: 1}}"))
    again = msnn.load(write_program_file(model, tmp_path), ["mpc.horizon=7"])
    control = again.of(ControlProblem)
    assert control is not None
    assert control.horizon == 7
    assert msnn.mpc(again).solve({"p": 1.0, "v": 0.0}).status == 0


def test_the_model_is_the_same_with_and_without_the_section(tmp_path: Path) -> None:
    alone = load(tmp_path, DOUBLE_INTEGRATOR).program
    beside = load(tmp_path, DOUBLE_INTEGRATOR + mpc()).program
    assert alone.step == beside.step
    assert alone.signals == beside.signals


def test_a_plant_in_a_submodel(tmp_path: Path) -> None:
    (tmp_path / "plant.yaml").write_text(DOUBLE_INTEGRATOR, encoding="utf-8")
    text = """
msnn: 1
name: whole
sample_time: 0.1 s
use: {plant: {spec: plant.yaml}}
inputs: {force: {}}
connect: {plant.u: 2 * force}
outputs: {place: plant.place}
mpc:
  horizon: 10
  controls: [force]
  cost: plant.p**2 + plant.v**2 + 0.1 * force**2
  bounds: {plant.v: {min: -0.5}}
"""
    model = load(tmp_path, text)
    found = msnn.mpc(model).solve({"plant.p": 1.0, "plant.v": 0.0})
    assert found.status == 0
    assert found.excess <= 1e-5


def test_full_names_reach_the_keys_of_signals_and_not_those_that_it_declares(tmp_path: Path):
    section = mpc(references="{r: {}}", bounds="{p: {max: r}, u: {min: -1, max: 1}}", horizon="4")
    entry = load(tmp_path, DOUBLE_INTEGRATOR + section).spec.of(OptimalControl)
    assert entry is not None
    renamed = Renaming("cart.", {"p": "cart.p", "v": "cart.v", "u": "cart.u"}).entry(entry)
    assert list(renamed.bounds) == ["cart.p", "cart.u"]
    assert list(renamed.references) == ["r"]
    assert [control.value for control in renamed.controls] == ["cart.u"]


def test_a_warning_about_the_model_is_reported_once(tmp_path: Path):
    text = DOUBLE_INTEGRATOR.replace("{between: hold}}", "{between: hold}, w: {unit: m}}")
    text = text.replace("{place: p}", "{place: p, odd: w + 2 s}")
    model = load(tmp_path, text + mpc())
    assert [warning.code for warning in model.warnings] == ["W0504"]

"""Values near a bound are called held or stuck by the derivative of the loss, for any optimizer."""

from __future__ import annotations

import numpy as np
import pytest

from msnn.training.plans.stage_data import stage_data
from msnn.training.plans.stage_plan import plan_stages
from msnn.training.records.learned.parameters_record import parameter_warnings
from msnn.training.records.learned.standard_errors import standard_errors
from msnn.training.records.learned.total_slope import with_bounds
from msnn.training.records.training_options import TrainingOptions
from msnn.training.train import train
from spec_schema.diagnostics.diagnostic import Findings
from tests.conditions import require_tool
from tests.training.cases import compiled, dataset

LINE = """
msnn: 1
name: line
inputs: {u: 1}
targets: {y: 1}
parameters: {a: {init: 1}, b: {init: 0.5, min: 0, max: 9}}
outputs: {z: {expr: a * u + b}}
losses: {fit: LOSS}
train: [{engine: ENGINE, optimizer: OPTIMIZER, dtype: float64}]
"""


@pytest.mark.parametrize("loss", ["'mse(z, y)'", "'mae(z, y)'", "'huber(z, y)'"])
@pytest.mark.parametrize("engine", ["native", "torch"])
@pytest.mark.parametrize("optimizer", ["adam", "lbfgs", "{torch: {name: Rprop}}"])
@pytest.mark.parametrize(
    ("b", "intercept", "code"),
    [
        (1e-9, 4.0, "W0914"),
        (0.0, 4.0, "W0914"),
        (9 - 1e-9, 4.0, "W0914"),
        (1e-9, -3.0, "W0904"),
        (0.0, -3.0, "W0904"),
        (9 - 1e-9, 12.0, "W0904"),
        (4.0, 4.0, None),
    ],
)
def test_a_saturated_value_is_never_called_held_by_its_bound(
    loss: str, engine: str, optimizer: str, b: float, intercept: float, code: str | None
) -> None:
    if engine == "native":
        require_tool("gcc", install="apt install gcc")
    text = LINE.replace("LOSS", loss).replace("ENGINE", engine).replace("OPTIMIZER", optimizer)
    program, spec = compiled(text)
    (plan,) = plan_stages(program, spec.train, Findings())
    u = np.linspace(-1, 1, 40)
    data = dataset({"u": u, "y": 0.7 * u + intercept}, train=[40])
    weights = {"a": np.array(0.7), "b": np.array(b)}
    stage = stage_data(plan, data, Findings())
    assert stage is not None
    found = with_bounds(standard_errors(plan, data, weights), plan, data, stage, weights)
    said = parameter_warnings(program, weights, found)
    assert [d.code for d in said] == ([] if code is None else [code])
    if code == "W0904":
        assert said[0].help == "the true value may lie beyond it"
    if code == "W0914":
        # what levenberg_marquardt refuses is no advice
        assert ("levenberg_marquardt" in (said[0].help or "")) == ("mae" not in loss)


@pytest.mark.parametrize("loss", ["'mse(z, y)'", "'huber(z, y)'"])
@pytest.mark.parametrize("optimizer", ["adam", "lbfgs", "{sgd: {lr: 0.1}}"])
@pytest.mark.parametrize("stuck", [0.0, 1e-9, 9.0])
def test_levenberg_marquardt_leaves_a_bound_at_which_a_stage_got_stuck(
    loss: str, optimizer: str, stuck: float
) -> None:
    """The advice of W0914."""
    text = (
        LINE.replace("LOSS", loss).replace("ENGINE", "torch").replace("init: 0.5", f"init: {stuck}")
    )
    first = "{engine: torch, optimizer: OPTIMIZER, dtype: float64"
    text = text.replace(
        first + "}", f"{first}, epochs: 1}}, {{engine: torch, optimizer: levenberg_marquardt}}"
    )
    program, spec = compiled(text.replace("OPTIMIZER", optimizer))
    u = np.linspace(-1, 1, 40)
    data = dataset({"u": u, "y": 0.7 * u + 4.0}, train=[40])
    found = train(program, data, spec.train, TrainingOptions(runs=None))
    # the model of a huber far from 0 is a rough one: each step has the same slope
    assert found.weights["b"] == pytest.approx(4.0, abs=1e-3)


@pytest.mark.parametrize("loss", ["'mse(z, y)'", "'mae(z, y)'"])
@pytest.mark.parametrize("optimizer", ["{adam: {lr: 0.1}}", "lbfgs"])
def test_an_initial_value_farther_inside_is_learned_from(loss: str, optimizer: str) -> None:
    """The other advice of W0914."""
    text = LINE.replace("LOSS", loss).replace("ENGINE", "torch").replace("init: 0.5", "init: 0.1")
    text = text.replace("dtype: float64", "dtype: float64, epochs: 300")
    program, spec = compiled(text.replace("OPTIMIZER", optimizer))
    u = np.linspace(-1, 1, 40)
    data = dataset({"u": u, "y": 0.7 * u + 4.0}, train=[40])
    found = train(program, data, spec.train, TrainingOptions(runs=None))
    assert found.weights["b"] == pytest.approx(4.0, abs=0.05)

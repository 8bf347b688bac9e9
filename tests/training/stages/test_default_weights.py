"""Without `losses:` outputs of unlike size count by the part of their variance (R9)."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from msnn.data.dataset import FloatArray
from msnn.training.plans.stage_data import with_default_weights
from msnn.training.plans.stage_plan import StagePlan, plan_stages
from msnn.training.records.progress import Silent, StageStart, stage_text
from msnn.training.stage_loss_module import stage_loss
from msnn.training.train import TrainingOptions, train
from spec_schema.diagnostics.diagnostic import Findings
from tests.training.cases import compiled, dataset

TWO = """
msnn: 1
name: two
inputs: {u: 1}
targets: {p: PUNIT, T: K}
parameters: {k: 1}
outputs:
  ph: {expr: "PGAIN * k * u", predicts: p}
  Th: {expr: 10 * k * u, predicts: T}
train: [{engine: torch, optimizer: levenberg_marquardt, STAGE}]
"""


def text_of(unit: str = "Pa", gain: str = "1e5", stage: str = "name: fit") -> str:
    return TWO.replace("PUNIT", unit).replace("PGAIN", gain).replace("STAGE", stage)


def series(gain: float = 1e5, noise: float = 0.5) -> dict[str, FloatArray]:
    """k is 2 by T, and by p, which is noisy, 2.3."""
    random = np.random.default_rng(4)
    u = random.uniform(1, 2, 200)
    p = 2.3 * gain * u * (1 + noise * random.normal(size=200))
    T = 20 * u + 0.01 * random.normal(size=200)
    T[7] = np.nan
    return {"u": u, "p": p, "T": T}


def weights_of(text: str, data: dict[str, FloatArray]) -> tuple[StagePlan, dict[str, float]]:
    program, spec = compiled(text)
    findings = Findings()
    plans = plan_stages(program, spec.train, findings)
    findings.raise_errors()
    (plan,) = with_default_weights(plans, dataset(data, train=[150], test=[50]))
    return plan, dict(plan.loss_weights)


def test_signals_of_unlike_units_are_weighed_by_their_variance_of_training() -> None:
    data = series()
    plan, weights = weights_of(text_of(), data)
    assert plan.weighs_by_variance
    # the last 50 rows are not trained on; a missing value has no part
    assert weights["ph"] == pytest.approx(1 / np.var(data["p"][:150]), rel=1e-12)
    assert weights["Th"] == pytest.approx(1 / np.nanvar(data["T"][:150]), rel=1e-12)


@pytest.mark.parametrize(("gain", "weighed"), [(20.0, False), (1000.0, True)])
def test_signals_of_one_unit_are_weighed_where_their_spread_differs_tenfold(
    gain: float, weighed: bool
) -> None:
    plan, weights = weights_of(text_of("K", str(gain)), series(gain, noise=0.0))
    assert plan.weighs_by_variance == weighed
    assert (weights == {"ph": 1.0, "Th": 1.0}) != weighed


def test_written_weights_keep_their_numbers() -> None:
    data = series()
    written = text_of() + 'losses: {ph: "mse(ph, p)", Th: "mse(Th, T)"}\n'
    assert weights_of(written, data)[1] == {"ph": 1.0, "Th": 1.0}
    stage = text_of(stage="losses: {ph: 0.5}")
    assert weights_of(stage, data)[1] == {"ph": 0.5, "Th": 1.0}


def test_one_output_and_signals_that_never_change() -> None:
    one = text_of().replace('ph: {expr: "1e5 * k * u", predicts: p}', "ph: k * u")
    assert weights_of(one, series())[1] == {"Th": 1.0}
    data = series()
    data["T"][:] = 300.0
    assert weights_of(text_of(), data)[1]["Th"] == pytest.approx(1 / 300**2)
    data["T"][:] = np.nan
    data["T"][-1] = 5.0
    assert weights_of(text_of(), data)[1]["Th"] == 1.0


def test_a_vector_counts_by_the_spread_of_its_elements() -> None:
    text = (
        "msnn: 1\nname: v\ndims: {c: 2}\ninputs: {u: 1}\ntargets: {y: {dims: c, unit: m}, z: s}\n"
        "parameters: {k: {init: 1, dims: c}}\n"
        "outputs: {yh: {expr: k * u, predicts: y}, zh: {expr: sum(k) * u, predicts: z}}\n"
        "train: [{engine: torch}]\n"
    )
    u = np.linspace(0, 1, 200)
    # elements that lie far apart vary no more for it
    y = np.stack([1000 + u, -1000 + 3 * u], axis=1)
    _, weights = weights_of(text, {"u": u, "y": y, "z": u})
    expected = (np.var(u[:150]) + np.var(3 * u[:150])) / 2
    assert weights["yh"] == pytest.approx(1 / expected, rel=1e-9)


class Heard(Silent):
    """Keeps the lines of stages."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def stage_started(self, event: StageStart) -> None:
        self.lines.append(stage_text(event))


def test_both_outputs_decide_a_shared_parameter_and_the_run_names_the_weights(
    tmp_path: Path,
) -> None:
    """By squares in Pa alone k is that of the noisy pressure."""
    values, heard = series(), Heard()
    program, spec = compiled(text_of())
    data = dataset(values, train=[200])
    result = train(program, data, spec.train, TrainingOptions(runs=tmp_path), heard)
    known = ~np.isnan(values["T"])
    up, ut = 1e5 * values["u"], 10 * values["u"][known]
    wp, wt = 1 / np.var(values["p"]) / 200, 1 / np.var(values["T"][known]) / 199
    above = wp * up @ values["p"] + wt * ut @ values["T"][known]
    expected = above / (wp * up @ up + wt * ut @ ut)
    assert result.weights["k"] == pytest.approx(expected, rel=1e-9)
    assert result.folder is not None
    (stage,) = json.loads((result.folder / "run.json").read_text())["stages"]
    assert stage["losses_by_variance"] is True
    assert stage["losses"] == pytest.approx({"ph": 200 * wp, "Th": 199 * wt})
    (line,) = heard.lines
    listed = ", ".join(f"{name} {weight:.3g}" for name, weight in stage["losses"].items())
    assert line.endswith(f"losses weighed by 1/variance: {listed}")


def test_the_loss_of_a_stage_in_python_has_the_same_weights() -> None:
    program, spec = compiled(text_of())
    loss = stage_loss(program, dataset(series(), train=[150], test=[50]), spec.train, 0, None)
    assert loss.plan.loss_weights == weights_of(text_of(), series())[1]

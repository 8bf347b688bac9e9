"""A loss that is not finite stops the run, names the first bad value and keeps the best weights."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from msnn.data.dataset import FloatArray
from msnn.data.rollout_rows import Runs
from msnn.model.weights.weights_file import read_weights
from msnn.training.engines.engine import NonFiniteLossError
from msnn.training.plans.stage_plan import plan_stages
from msnn.training.records.training_options import TrainingOptions
from msnn.training.stages.divergence import explain_divergence
from msnn.training.train import train
from msnn.training.training_result import TrainingDivergedError
from spec_schema.diagnostics.diagnostic import Findings
from tests.conditions import require_tool
from tests.training.cases import compiled, dataset

TEXT = """msnn: 1
name: plant
sample_time: 1 s
inputs: {x: 1}
parameters:
  a: {init: 0.9}
equations:
  grown: exp(a * x)
outputs:
  y: {expr: grown - 1, predicts: "x[t+1]"}
train:
"""


def test_the_first_bad_value_and_its_line_are_named(tmp_path: Path) -> None:
    program, spec = compiled(TEXT + "  - {name: far, rollout: 30, epochs: 2}\n")
    data = dataset({"x": np.full(100, 2.0)}, train=[100])
    with pytest.raises(TrainingDivergedError) as caught:
        train(program, data, spec.train, TrainingOptions(runs=tmp_path))
    diagnostic = caught.value.diagnostic
    assert diagnostic.code == "E0913"
    assert "stage `far` diverged in epoch 1: `grown` is not finite at step" in diagnostic.message
    assert "train0.csv" in diagnostic.message
    assert diagnostic.span is not None
    assert diagnostic.span.line == 8
    folder = caught.value.result.folder
    assert folder is not None
    kept = read_weights(folder / "weights.safetensors", program)
    assert kept["a"] == caught.value.result.weights["a"]


@pytest.mark.parametrize(
    ("grown", "named"),
    [
        ("2 * exp(a * x) / 3", "`exp` in `grown`"),
        ("1 + a / (x - x)", "a quotient in `grown`"),
        ("1 - 1e38 * x * x * 1e300 * a", "a product in `grown`"),
        ("1 + log(a - 1) + x", "`log` in `grown`"),
    ],
)
def test_what_has_no_name_is_named_by_its_equation(grown: str, named: str) -> None:
    text = TEXT.replace("exp(a * x)", grown) + "  - {rollout: 30, epochs: 2}\n"
    program, spec = compiled(text)
    data = dataset({"x": np.full(100, 2.0)}, train=[100])
    with pytest.raises(TrainingDivergedError) as caught:
        train(program, data, spec.train, TrainingOptions(runs=None))
    assert f": {named} is not finite at step" in caught.value.diagnostic.message


@pytest.mark.parametrize(
    ("optimizer", "repair"),
    [
        ("{sgd: {lr: 1}}", "try a smaller learning rate or `clip:`"),
        ("lbfgs", "try a smaller learning rate or `clip:`"),
        ("levenberg_marquardt", "try `min:` and `max:` of `a`, or an `init` that is nearer"),
    ],
)
def test_advice_against_an_infinite_parameter_names_keys_of_its_optimizer(
    optimizer: str, repair: str
) -> None:
    program, spec = compiled(TEXT + f"  - {{rollout: 3, epochs: 2, optimizer: {optimizer}}}\n")
    (plan,) = plan_stages(program, spec.train, Findings())
    data = dataset({"x": np.full(100, 2.0)}, train=[100])
    fault = NonFiniteLossError(Runs(np.arange(5), np.full(5, 3), 0, 100))
    said = explain_divergence(plan, data, {"a": np.array(np.inf)}, fault, 2)
    assert said.code == "E0914"
    assert said.help == repair


def test_the_best_weights_before_are_kept() -> None:
    program, spec = compiled(
        TEXT + "  - {epochs: 3, optimizer: {sgd: {lr: 0.001}}}\n"
        "  - {epochs: 5, optimizer: {sgd: {lr: 1e30}}}\n"
    )
    data = dataset({"x": np.full(50, 0.1)}, train=[50])
    with pytest.raises(TrainingDivergedError) as caught:
        train(program, data, spec.train, TrainingOptions(runs=None))
    result = caught.value.result
    assert len(result.stages) == 1
    assert np.isfinite(result.weights["a"])
    assert result.weights["a"] == result.stages[0].best["a"]


def test_the_best_weights_of_the_stage_that_diverges_are_kept(tmp_path: Path) -> None:
    """Its rate is right for `b` and too large for `a`, whose small error grows by half a step."""
    stage = "epochs: 400, batch: 64, optimizer: {sgd: {lr: 1.25}}, engine: native"
    program, spec = compiled(
        "msnn: 1\nname: slow\nsample_time: 1 s\ninputs: {x: 1, u: 1}\ntargets: {z: 1}\n"
        "parameters: {a: 0.750001, b: 0}\noutputs: {y: {expr: a*x + b*u, predicts: z}}\n"
        f"train: [{{{stage}}}]\n"
    )
    x, u = np.tile([1.0, 1.0, -1.0, -1.0], 16), 0.3 * np.tile([1.0, -1.0, 1.0, -1.0], 16)
    data = dataset({"x": x, "u": u, "z": 0.75 * x + 0.25 * u}, train=[64])
    with pytest.raises(TrainingDivergedError) as caught:
        train(program, data, spec.train, TrainingOptions(runs=tmp_path))
    found = caught.value.result
    assert found.folder is not None
    kept = read_weights(found.folder / "weights.safetensors", program)
    for weights in (found.weights, kept):
        assert weights["a"] == pytest.approx(0.75, abs=0.01)
        assert weights["b"] == pytest.approx(0.25, abs=0.01)


def test_other_commands_keep_the_run_that_ended(tmp_path: Path) -> None:
    good, spec = compiled(TEXT + "  - {epochs: 1, optimizer: {sgd: {lr: 0.001}}}\n")
    data = dataset({"x": np.full(50, 0.1)}, train=[50])
    folder = train(good, data, spec.train, TrainingOptions(runs=tmp_path)).folder
    assert folder is not None
    wild, spec = compiled(TEXT + "  - {epochs: 5, optimizer: {sgd: {lr: 1e30}}}\n")
    with pytest.raises(TrainingDivergedError) as caught:
        train(wild, data, spec.train, TrainingOptions(runs=tmp_path))
    assert caught.value.result.folder != folder
    assert (tmp_path / "plant" / "latest").resolve() == folder.resolve()


def test_a_loss_too_large_for_a_number_diverges_without_a_word_of_numpy() -> None:
    program, spec = compiled(TEXT.replace("exp(a * x)", "a * x * 1e160") + "  - {epochs: 2}\n")
    data = dataset({"x": np.full(50, 2.0)}, train=[50])
    with pytest.raises(TrainingDivergedError):  # warnings are errors in the tests
        train(program, data, spec.train, TrainingOptions(runs=None))


def advice(text: str, series: dict[str, FloatArray]) -> str:
    """The help of E0913, which must not be that of another weight or rate before any update."""
    program, spec = compiled(text)
    rows = len(next(iter(series.values())))
    with pytest.raises(TrainingDivergedError) as caught:
        train(program, dataset(series, train=[rows]), spec.train, TrainingOptions(runs=None))
    assert caught.value.diagnostic.code == "E0913"
    return caught.value.diagnostic.help or ""


def trains(text: str, series: dict[str, FloatArray]) -> float:
    """The best loss of a training that reaches its end."""
    program, spec = compiled(text)
    data = dataset(series, train=[len(next(iter(series.values())))])
    return train(program, data, spec.train, TrainingOptions(runs=None)).stages[-1].best_value


TANK = """msnn: 1
name: tank
sample_time: 0.5 s
inputs: {q: {}, h: {}}
parameters: {c: {init: 0.2, min: 0}}
states: {s: {der: "q - c * ROOT", init: h.meas}}
outputs: {hn: {expr: next(s), predicts: "h[t+1]"}}
train: [{engine: ENGINE, epochs: 3, optimizer: OPTIMIZER, rollout: {horizon: 50, stride: 25}}]
"""


@pytest.mark.parametrize("engine", ["native", "torch"])
@pytest.mark.parametrize("optimizer", ["{adam: {lr: 0.01}}", "levenberg_marquardt"])
@pytest.mark.parametrize(
    ("root", "repaired"), [("sqrt(s)", "sqrt(max(s, 0))"), ("s ** 0.7", "max(s, 0) ** 0.7")]
)
def test_a_root_of_what_runs_empty_is_told_to_stay_above_zero(
    engine: str, optimizer: str, root: str, repaired: str
) -> None:
    if engine == "native":
        require_tool("gcc", install="apt install gcc")
    h = np.maximum(1 - 0.02 * np.arange(150.0), 0)
    series = {"q": np.zeros(150), "h": h}
    text = TANK.replace("ENGINE", engine).replace("OPTIMIZER", optimizer)
    said = advice(text.replace("ROOT", root), series)
    written = repaired.replace("s,", "x,").replace("0.7", "p")
    assert said.startswith(f"write `{written}` for ")
    assert "rate" not in said
    assert np.isfinite(trains(text.replace("ROOT", repaired), series))


@pytest.mark.parametrize(
    ("grown", "repaired", "written"),
    [
        ("log(x - 2)", "log(max(x - 2, 1e-9))", "`log(max(x, 1e-9))`"),
        ("asin(x)", "asin(clip(x, -1, 1))", "`asin(clip(x, -1, 1))`"),
        ("acos(x)", "acos(clip(x, -1, 1))", "`acos(clip(x, -1, 1))`"),
        ("1 / (x - 2)", "1 / max(x - 2, 1e-9)", "`max(d, 1e-9)`"),
    ],
)
def test_a_value_outside_of_a_function_is_told_the_formula_that_stays_inside(
    grown: str, repaired: str, written: str
) -> None:
    text = TEXT + "  - {epochs: 2}\n"
    series = {"x": np.full(50, 2.0)}
    said = advice(text.replace("exp(a * x)", f"a * {grown}"), series)
    assert written in said
    assert np.isfinite(trains(text.replace("exp(a * x)", f"a * {repaired}"), series))


STIFF = """msnn: 1
name: vdp
sample_time: 0.05 s
inputs: {x: {}}
parameters: {mu: {init: 20, min: 0}}
states: {p: {der: v, init: x.meas}, v: {der: "mu * (1 - p ** 2) * v - p", init: 0}}
integrator: INTEGRATOR
outputs: {xh: {expr: next(p), predicts: "x[t+1]"}}
train: [{engine: torch, epochs: 4, optimizer: OPTIMIZER, rollout: {horizon: record}}]
"""


@pytest.mark.parametrize("optimizer", ["levenberg_marquardt", "{adam: {lr: 1e-6}}"])
def test_a_state_that_the_integrator_cannot_follow_is_told_of_substeps(optimizer: str) -> None:
    """Van der Pol, mu 20 (https://doi.org/10.1080/14786442608564127): relaxation oscillations."""
    text = STIFF.replace("OPTIMIZER", optimizer)
    x = 2.0 - 0.01 * np.arange(60.0)
    x[40:] = -2.0
    said = advice(text.replace("INTEGRATOR", "rk4"), {"x": x})
    assert said.startswith("try `integrator: {rk4: {substeps: 10}}` or `linear_implicit`")
    assert "rate" not in said
    for integrator in ("{rk4: {substeps: 10}}", "linear_implicit"):
        assert np.isfinite(trains(text.replace("INTEGRATOR", integrator), {"x": x}))


def test_before_any_update_no_rate_is_to_blame() -> None:
    series = {"x": np.full(100, 2.0)}
    said = advice(TEXT + "  - {rollout: 30, epochs: 2}\n", series)
    assert said.startswith("try initial values with which the rollout stays finite")
    assert "learning rate" not in said
    later = TEXT.replace("init: 0.9", "init: 0.1").replace("exp(a * x)", "exp(a * x) * x")
    said = advice(later + "  - {rollout: 5, epochs: 9, optimizer: {sgd: {lr: 1e3}}}\n", series)
    assert "a smaller learning rate" in said


LINE = """msnn: 1
name: line
inputs: {x: 1}
targets: {y: 1}
parameters: {a: 0.5, b: 0.5}
outputs: {z: {expr: a*x + b*x*x, predicts: "y[t]"}}
train: [{engine: torch, epochs: 100, batch: 10, optimizer: OPTIMIZER}]
"""


def test_a_loss_that_grows_without_bound_is_told_of_the_rate() -> None:
    """Every value is finite, the sum of their squares is not: the steps are too long."""
    x = np.linspace(0, 5, 60)
    series = {"x": x, "y": 1.5 * x - 0.2 * x * x}
    said = advice(LINE.replace("OPTIMIZER", "{sgd: {lr: 1}}"), series)
    assert said.startswith("try a smaller learning rate, or give the losses smaller weights")
    assert np.isfinite(trains(LINE.replace("OPTIMIZER", "{sgd: {lr: 0.001}}"), series))


@pytest.mark.parametrize("optimizer", ["{sgd: {lr: 1}}", "levenberg_marquardt"])
def test_a_loss_too_large_from_the_beginning_is_not_told_of_the_rate(optimizer: str) -> None:
    x = np.linspace(1, 5, 60) * (1e19 if "sgd" in optimizer else 1e160)
    text = LINE.replace("a*x + b*x*x", "a*x + b").replace(", batch: 10", "")
    said = advice(text.replace("OPTIMIZER", optimizer), {"x": x, "y": -x})
    assert said.startswith("give the losses smaller weights")

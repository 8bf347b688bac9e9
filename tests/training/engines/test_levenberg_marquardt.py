"""Levenberg-Marquardt: problems with known answers, both engines, what it refuses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from backends.gauss_newton_products import Products
from compiler.interpreter.interpreter import Interpreter
from msnn.data.dataset import FloatArray
from msnn.data.rollout_rows import Runs
from msnn.training.engines.engine import EngineState
from msnn.training.engines.native.native_squares import NativeSquares
from msnn.training.engines.second_order.levenberg_marquardt import LevenbergMarquardtEngine
from msnn.training.engines.torch.torch_engine import TorchEngine
from msnn.training.engines.torch.torch_squares import TorchSquares
from msnn.training.plans.stage_plan import plan_stages
from msnn.training.records.progress import EpochEnd, Silent, StageEnd
from msnn.training.records.training_options import TrainingOptions
from msnn.training.train import train
from msnn.training.training_result import TrainingDivergedError, TrainingResult
from spec_schema.diagnostics.diagnostic import Findings, SpecError
from tests.conditions import require_tool
from tests.native.test_kernel import MODELS, initial, log_of
from tests.training.cases import GAIN, compiled, dataset, gain, gain_series
from tests.training.engines.test_engines import planned, runs_of

IN_MEMORY = TrainingOptions(runs=None)
ENGINES = {"native": NativeSquares, "torch": TorchSquares}


class Ends(Silent):
    """Keeps how stages end, and the totals of their epochs."""

    def __init__(self) -> None:
        self.stages: list[StageEnd] = []
        self.totals: list[float] = []

    def epoch_ended(self, event: EpochEnd) -> None:
        self.totals.append(event.total)

    def stage_ended(self, event: StageEnd) -> None:
        self.stages.append(event)


def run(text: str, series: dict[str, FloatArray], progress: Silent | None = None) -> TrainingResult:
    program, spec = compiled(text)
    data = dataset(series, train=[len(next(iter(series.values())))])
    return train(program, data, spec.train, IN_MEMORY, progress)


@pytest.fixture(params=ENGINES)
def engine(request: pytest.FixtureRequest) -> str:
    if request.param == "native":
        require_tool("gcc", install="apt install gcc")
    return request.param


def test_one_step_solves_linear_least_squares(engine: str) -> None:
    stage = (
        f"  - {{epochs: 1, engine: {engine}, "
        "optimizer: {levenberg_marquardt: {damping: 1e-12}}}\n"
    )
    program, spec = gain(stage)
    series = gain_series(80)
    series["x"] += np.random.default_rng(3).normal(0, 0.1, 80)
    result = train(program, dataset(series, train=[80]), spec.train, IN_MEMORY)
    regressors = np.stack([series["x"][:-1], series["u"][:-1]], axis=1)
    (a, b), *_ = np.linalg.lstsq(regressors, series["x"][1:])
    assert result.weights["a"] == pytest.approx(a, rel=1e-9)
    assert result.weights["b"] == pytest.approx(b, rel=1e-9)


def test_weight_decay_is_ridge_regression(engine: str) -> None:
    """mse + λ/2 · (a² + (b/s)²), as adam adds λ · raw to its slope, has this solution."""
    decay, scale = 0.2, 0.5
    text = GAIN.replace("b: 0.0", f"b: {{init: 0.0, scale: {scale}}}") + (
        f"train: [{{epochs: 30, weight_decay: {decay}, engine: {engine}, "
        "optimizer: levenberg_marquardt}]\n"
    )
    series = gain_series(80)
    series["x"] += np.random.default_rng(3).normal(0, 0.1, 80)
    result = run(text, series)
    columns = np.stack([series["x"][:-1], series["u"][:-1]], axis=1)
    pull = decay / 2 * 79 * np.diag([1.0, 1 / scale**2])
    wanted = np.linalg.solve(columns.T @ columns + pull, columns.T @ series["x"][1:])
    found = [float(result.weights[name]) for name in ("a", "b")]
    assert found == pytest.approx(wanted, rel=1e-8)
    program, spec = compiled(text.replace("levenberg_marquardt", "{sgd: {lr: 0.5}}"))
    (plan,) = plan_stages(program, spec.train, Findings())
    plan = replace(plan, dtype="float64")
    first = {"a": np.array(0.5), "b": np.array(0.0)}
    descent = TorchEngine(plan, series, first, None, None)
    for _ in range(200):
        descent.train_batches(Runs(np.arange(79), np.ones(79, np.int64), 0, 80), 79)
    assert [float(descent.weights()[name]) for name in "ab"] == pytest.approx(wanted, rel=1e-8)


def test_validation_stops_it_early_and_keeps_the_best(engine: str) -> None:
    """Eleven powers through twelve noisy points: the best rows held out come before the end."""
    text = (
        "msnn: 1\nname: curve\ninputs: {u: 1}\ntargets: {y: 1}\ndims: {power: 11}\n"
        "parameters: {w: {dims: power, init: 0}}\n"
        'outputs: {z: {expr: "sum(w * u ** n)", predicts: "y[t]"}}\n'
        "constants: {n: {value: [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10], dims: power}}\n"
        f"train: [{{epochs: 60, engine: {engine}, early_stop: {{patience: 4}}, "
        "optimizer: {levenberg_marquardt: {damping: 100}}}]\n"
    )
    random = np.random.default_rng(7)
    u = random.uniform(-1, 1, 36)
    y = np.sin(2 * u) + random.normal(0, 0.2, 36)
    program, spec = compiled(text)
    data = dataset({"u": u, "y": y}, train=[12], val=[24])
    (stage,) = train(program, data, spec.train, IN_MEMORY).stages
    assert stage.reason == "no better for 4 epochs"
    assert stage.best_epoch == stage.epochs - 4 > 0
    fitted = np.polynomial.Polynomial(stage.best["w"])(u[12:])
    assert np.mean((fitted - y[12:]) ** 2) == pytest.approx(stage.best_value, rel=1e-9)


ROSENBROCK = """
msnn: 1
name: valley
inputs: {u: 1}
parameters: {a: -1.2, b: 1}
outputs: {y: {expr: u}}
losses: {valley: "l2(10 * (b - a * a))", top: l2(1 - a)}
train: [{epochs: 40, engine: ENGINE, optimizer: levenberg_marquardt}]
"""


def test_the_valley_of_rosenbrock(engine: str) -> None:
    """Rosenbrock (1960) as two residuals; its minimum is 0 at (1, 1)."""
    ends = Ends()
    result = run(ROSENBROCK.replace("ENGINE", engine), {"u": np.zeros(3)}, ends)
    assert result.weights["a"] == pytest.approx(1.0, abs=1e-8)
    assert result.weights["b"] == pytest.approx(1.0, abs=1e-8)
    (end,) = ends.stages
    assert end.epochs < 40
    assert end.reason == "converged"
    assert ends.totals == sorted(ends.totals, reverse=True)


OSCILLATOR = """
msnn: 1
name: oscillator
sample_time: 0.1 s
inputs: {F: N}
parameters:
  m: {init: 1, min: 0, unit: kg}
  d: {init: 1, min: 0, max: 5, unit: N*s/m}
  k: {init: 10, max: 100, unit: N/m}
states:
  x: {unit: m, der: v, init: x.meas}
  v: {unit: m/s, der: (F - d*v - k*x) / m, init: 0}
outputs: {x_next: {expr: next(x), predicts: "x[t+1]"}}
train: [{epochs: 60, rollout: episode, engine: ENGINE, optimizer: levenberg_marquardt}]
"""
TRUE = {"m": 1.3, "d": 0.4, "k": 23.0}


def oscillation(rows: int) -> dict[str, FloatArray]:
    """Exact data of the oscillator with the true parameters."""
    program, _ = compiled(OSCILLATOR.replace("ENGINE", "auto"))
    force = np.sign(np.sin(0.23 * np.arange(rows))) * 3
    log = {"F": force, "x": np.full(rows, 0.2)}
    judge = Interpreter(program, TRUE)
    found = judge.rollout(log, [0], rows - 1).outputs["x_next"][0]
    return {"F": force, "x": np.concatenate([[0.2], found])}


def test_physical_parameters_within_bounds(engine: str) -> None:
    result = run(OSCILLATOR.replace("ENGINE", engine), oscillation(60))
    for name, value in TRUE.items():
        assert result.weights[name] == pytest.approx(value, rel=1e-6)


def test_a_bound_that_is_in_the_way_is_kept(engine: str) -> None:
    """On a short record: torch takes each slope through each step of each of the epochs."""
    text = OSCILLATOR.replace("ENGINE", engine).replace("max: 100", "max: 20")
    result = run(text.replace("epochs: 60", "epochs: 20"), oscillation(30))
    assert result.weights["k"] == 20.0


def test_parameters_that_only_count_together(engine: str) -> None:
    text = (
        "msnn: 1\nname: twins\ninputs: {u: 1}\ntargets: {y: 1}\n"
        "parameters: {a: 0.5, b: 0.1, c: 7}\n"
        'outputs: {z: {expr: (a + b) * u + 0 * c, predicts: "y[t]"}}\n'
        f"train: [{{engine: {engine}, optimizer: levenberg_marquardt}}]\n"
    )
    u = np.linspace(-1, 1, 20)
    result = run(text, {"u": u, "y": 2 * u})
    assert result.weights["a"] + result.weights["b"] == pytest.approx(2, abs=1e-6)
    assert result.weights["c"] == 7


@pytest.mark.parametrize("delta", [1.0, 0.2, 4.0])
def test_huber_reaches_the_minimum_of_huber(engine: str, delta: float) -> None:
    text = (
        "msnn: 1\nname: line\ninputs: {u: 1}\ntargets: {y: 1}\nparameters: {a: 0, b: 0}\n"
        'outputs: {z: {expr: a * u + b}}\nlosses: {fit: "huber(z, y, delta='
        f'{delta})"}}\n'
        f"train: [{{engine: {engine}, optimizer: {{levenberg_marquardt: {{tolerance: 1e-13}}}}}}]\n"
    )
    u = np.linspace(-2, 2, 41)
    y = 3 * u + 0.5 + np.random.default_rng(5).normal(0, 0.3, 41)
    y[::7] += 40
    result = run(text, {"u": u, "y": y})
    error = result.weights["a"] * u + result.weights["b"] - y
    slope = np.clip(error, -delta, delta)
    # the slope of huber, clip(e), is orthogonal to both columns at the minimum
    assert slope @ u == pytest.approx(0, abs=1e-4)
    assert slope.sum() == pytest.approx(0, abs=1e-4)


@pytest.mark.parametrize("model", [name for name in MODELS if name != "classes"])
def test_both_engines_take_the_same_steps(model: str) -> None:
    require_tool("gcc", install="apt install gcc")
    text = MODELS[model][0].replace("mae(", "huber(")
    stage = "rollout: {horizon: 8, skip: 2}, optimizer: levenberg_marquardt"
    program, plan = planned(text, stage)
    log = log_of(program)
    runs = runs_of(8)
    found: list[tuple[list[float], dict[str, FloatArray]]] = []
    for squares in ENGINES.values():
        one = LevenbergMarquardtEngine(plan, log, initial(program), None, None, squares)
        totals = [
            sum(value.total / value.count for value in one.train_batches(runs, len(runs)).values())
            for _ in range(4)
        ]
        found.append((totals, one.weights()))
    (native, native_weights), (torch, torch_weights) = found
    # rounding grows where the curvature is nearly singular
    assert native == pytest.approx(torch, rel=1e-8)
    for name, weight in torch_weights.items():
        np.testing.assert_allclose(native_weights[name], weight, rtol=1e-6, atol=1e-8)


def test_every_fact_of_its_state_is_restored() -> None:
    program, plan = planned(MODELS["arm"][0], "rollout: 8, optimizer: levenberg_marquardt")
    one, other = (
        LevenbergMarquardtEngine(plan, log_of(program), initial(program), None, None, TorchSquares)
        for _ in range(2)
    )
    one.train_batches(runs_of(8), 100)
    structure = one.state().structure
    assert isinstance(structure, dict)
    structure |= {"damping": 3.0, "growth": 16.0, "finished": "converged"}
    arrays = {name: values + 0.25 for name, values in one.state().arrays.items()}
    arrays |= {"t0": np.array([4.0, 9.0]), "steps": np.array([8.0, 7.0])}
    other.restore(EngineState(arrays, structure))
    found = other.state()
    assert found.structure == structure
    assert other.finished == "converged"
    assert found.arrays.keys() == arrays.keys()
    for name, values in arrays.items():
        np.testing.assert_array_equal(found.arrays[name], values)


def test_missing_targets_frozen_parameters_and_unequal_rollouts(engine: str) -> None:
    text = (
        "msnn: 1\nname: gain\nsample_time: 1 s\ninputs: {x: m, u: m}\ntargets: {z: m}\n"
        "parameters: {a: 0.5, b: 0.3, c: 0.1}\n"
        'outputs: {x_next: {expr: "a*x + b*u", predicts: "x[t+1]"}}\n'
        "losses: {fit: 'mse(x_next, x[t+1])', other: {expr: 'mse(c * u, z)', weight: 3}}\n"
        "train: [{freeze: [b], rollout: {horizon: episode, skip: 2}, "
        f"engine: {engine}, optimizer: levenberg_marquardt}}]\n"
    )
    program, spec = compiled(text)
    series = gain_series(100)
    series["z"] = np.where(np.arange(100) % 3, np.nan, -2 * series["u"])
    data = dataset(series, train=[30, 45, 25])
    result = train(program, data, spec.train, IN_MEMORY)
    assert result.weights["a"] == pytest.approx(0.8, abs=1e-7)
    assert result.weights["b"] == 0.3
    assert result.weights["c"] == pytest.approx(-2.0, abs=1e-7)


@pytest.mark.parametrize(
    ("stage", "losses", "code"),
    [
        ("{}", "mae(x_next, x[t+1])", "E0930"),
        ("{}", "rmse(x_next, x[t+1])", "E0930"),
        ("{}", "l1(a * u)", "E0930"),
        ("{}", "exp(a)", "E0930"),
        ("{batch: 5}", "mse(x_next, x[t+1])", "E0931"),
        ("{lr: {a: 0.1}}", "mse(x_next, x[t+1])", "E0931"),
        ("{schedule: {cosine: {}}}", "mse(x_next, x[t+1])", "E0931"),
        ("{clip: 1}", "mse(x_next, x[t+1])", "E0931"),
        ("{dtype: float32}", "mse(x_next, x[t+1])", "E0931"),
    ],
)
def test_what_it_cannot_do_is_said(stage: str, losses: str, code: str) -> None:
    keys = stage[1:-1]
    program, spec = gain(
        f"  - {{optimizer: levenberg_marquardt{', ' if keys else ''}{keys}}}\n",
        f"losses: {{fit: '{losses}'}}\n",
    )
    with pytest.raises(SpecError) as caught:
        train(program, dataset(gain_series(50), train=[50]), spec.train, IN_MEMORY)
    (found,) = [d for d in caught.value.diagnostics if d.severity == "error"]
    assert found.code == code
    if code == "E0930":
        assert found.span is not None
        assert found.span.line == (GAIN + "train:\n  - {}\n").count("\n") + 1


@pytest.mark.parametrize("loss", ["l1(2 * a)", "l1(k)", "2 * l1(k)"])
def test_l1_without_corners_is_told_where_factors_go(loss: str) -> None:
    text = GAIN.replace("parameters: {", "parameters: {k: {init: 1, min: 0}, ")
    program, spec = compiled(
        text + "train:\n  - {optimizer: levenberg_marquardt}\n"
        f"losses: {{fit: 'mse(x_next, x[t+1])', few: '{loss}', right: '2 * l1(a)'}}\n"
    )
    with pytest.raises(SpecError) as caught:
        train(program, dataset(gain_series(50), train=[50]), spec.train, IN_MEMORY)
    (found,) = [d for d in caught.value.diagnostics if d.severity == "error"]
    assert found.code == "E0930"
    assert "`few`: l1 of an expression, or of bounded numbers, is no sum" in found.message
    assert found.help is not None
    assert "factors outside: `2 * l1(f.weight)`" in found.help


def test_a_loss_of_weight_0_may_be_anything() -> None:
    program, spec = gain(
        "  - {optimizer: levenberg_marquardt, losses: {shape: 0}}\n",
        "losses: {fit: 'mse(x_next, x[t+1])', shape: 'mae(x_next, x[t+1])'}\n",
    )
    result = train(program, dataset(gain_series(50), train=[50]), spec.train, IN_MEMORY)
    assert result.weights["a"] == pytest.approx(0.8, abs=1e-8)


def test_a_curriculum_goes_on_after_a_short_horizon_converged() -> None:
    ends = Ends()
    program, spec = gain(
        "  - {epochs: 20, rollout: {horizon: 6, curriculum: {10: 2}}, "
        "optimizer: levenberg_marquardt}\n"
    )
    series = gain_series(80)
    series["x"] += np.random.default_rng(3).normal(0, 0.1, 80)
    train(program, dataset(series, train=[80]), spec.train, IN_MEMORY, ends)
    (end,) = ends.stages
    assert 10 < end.epochs < 20
    assert end.reason == "converged"


ROOT = """
msnn: 1
name: root
inputs: {u: 1}
targets: {z: 1}
parameters: {k: FIRST}
outputs: {y: {expr: "u * (sqrt(max(k - 1, 0)) + 1e-9 / (1 + exp(1e6 * (1 - k))))", predicts: "z"}}
train: [{epochs: 60, engine: ENGINE, optimizer: {levenberg_marquardt: {damping: 1e-6}}}]
"""
"""From k = 3 the first step ends at −0.7: the loss is smaller there, its slope exp(1.7e6) · 0."""


class NoSlopesBelow(NativeSquares):
    """Squares whose slopes are NaN where `a` is below 0.9: the best is 0.8."""

    def products(self, runs: Runs, weights: Mapping[str, FloatArray]) -> dict[str, Products]:
        found = super().products(runs, weights)
        spoiled = np.nan if float(weights["a"]) < 0.9 else 1.0
        return {name: replace(one, slope=one.slope * spoiled) for name, one in found.items()}


def test_a_step_to_slopes_that_are_not_finite_is_not_taken(engine: str) -> None:
    u = np.linspace(1, 2, 40)
    series = {"u": u, "z": 0.1 * u}
    found = run(ROOT.replace("ENGINE", engine).replace("FIRST", "3"), series)
    assert found.weights["k"] == pytest.approx(1.01, rel=1e-6)


def test_such_a_step_grows_the_damping() -> None:
    require_tool("gcc", install="apt install gcc")
    program, spec = gain("  - {epochs: 9, optimizer: {levenberg_marquardt: {damping: 1e-9}}}\n")
    findings = Findings()
    (plan,) = plan_stages(program, spec.train, findings)
    series = gain_series(80)
    first = {"a": np.array(1.5), "b": np.array(0.0)}
    engine = LevenbergMarquardtEngine(plan, series, first, None, None, NoSlopesBelow)
    runs = Runs(np.arange(5, 70), np.ones(65, np.int64), 0, 80)
    before = np.inf
    for _ in range(9):
        (loss,) = engine.train_batches(runs, 65).values()
        assert loss.total <= before
        before = loss.total
        assert engine.weights()["a"] >= 0.9
    assert engine.weights()["a"] == pytest.approx(0.9, abs=0.02)


def test_slopes_that_are_not_finite_at_the_start_are_named(engine: str) -> None:
    u = np.linspace(1, 2, 40)
    with pytest.raises(TrainingDivergedError) as caught:
        run(ROOT.replace("ENGINE", engine).replace("FIRST", "-1"), {"u": u, "z": 0.1 * u})
    said = caught.value.diagnostic
    assert said.code == "E0985"
    assert "the loss is finite, its slope in `k` is not" in said.message
    assert said.help is not None
    assert "learning rate" not in said.help


def test_advice_against_a_loss_that_is_not_finite_fits_the_optimiser(engine: str) -> None:
    text = ROOT.replace("ENGINE", engine).replace("FIRST", "3")
    with pytest.raises(TrainingDivergedError) as caught:
        run(text.replace("max(k - 1, 0)", "1 - k"), {"u": np.ones(20), "z": np.ones(20)})
    said = caught.value.diagnostic
    assert said.code == "E0913"
    assert said.help == "write `sqrt(max(x, 0))` for `sqrt(x)`: x falls below 0 there"


@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_a_limit_that_no_row_reaches_is_passed(engine: str, noise: float) -> None:
    """A parameter that rightly counts for nothing at the minimum does not keep others from it."""
    text = """
msnn: 1
name: limited
inputs: {u: 1}
targets: {y: 1}
parameters: {k: 0.5, c: 0.4}
outputs: {z: {expr: "min(k*u, c)", predicts: "y[t]"}}
train: [{engine: ENGINE, epochs: 40, optimizer: levenberg_marquardt}]
"""
    u = np.linspace(-2, 2, 200)
    y = 1.5 * u + noise * np.random.default_rng(3).normal(size=200)
    found = run(text.replace("ENGINE", engine), {"u": u, "y": y})
    assert found.stages[0].reason == "converged"
    assert found.weights["k"] == pytest.approx(1.5, abs=0.2 * noise + 1e-9)

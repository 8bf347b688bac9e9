"""Standard errors: linear regression by the book, coverage, what the data do not determine."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from compiler.ir.program import Parameter
from compiler.ir.types import Axis
from msnn.data.dataset import FloatArray
from msnn.model.weights.weights_file import initial_weights
from msnn.reports.training_summary import errors_note, parameters_table
from msnn.training.plans.stage_plan import StagePlan, plan_stages
from msnn.training.records.learned import standard_errors as module
from msnn.training.records.learned.beside_bounds import is_near_bound
from msnn.training.records.learned.parameters_record import parameter_warnings, parameters_record
from msnn.training.records.learned.standard_errors import StandardErrors, standard_errors
from msnn.training.records.training_options import black_boxes
from msnn.training.train import TrainingOptions, train
from spec_schema.diagnostics.diagnostic import Findings
from tests.training.cases import compiled, dataset, gain, gain_series

LINE = """
msnn: 1
name: line
inputs: {u: 1}
targets: {y: 1}
parameters: {a: {init: 1, unit: 1/s}, b: {init: 0.5, min: 0, max: 9}}
outputs: {z: {expr: a * u + b}}
losses: {fit: LOSS}
train: [{engine: torch, optimizer: levenberg_marquardt}]
"""
MSE = "'mse(z, y)'"


@cache
def planned(text: str) -> StagePlan:
    program, spec = compiled(text)
    findings = Findings()
    (plan,) = plan_stages(program, spec.train, findings)
    findings.raise_errors()
    return plan


def line(noise: float, seed: int, rows: int = 60) -> dict[str, FloatArray]:
    random = np.random.default_rng(seed)
    u = random.uniform(-2, 3, rows)
    return {"u": u, "y": 0.7 * u + 2.0 + random.normal(0, noise, rows)}


def by_the_book(series: dict[str, FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Estimates and standard errors of y = a u + b by ordinary least squares."""
    columns = np.stack([series["u"], np.ones_like(series["u"])], axis=1)
    estimate, (squares,), *_ = np.linalg.lstsq(columns, series["y"])
    variance = squares / (len(columns) - 2)
    covariance: FloatArray = variance * np.linalg.inv(columns.T @ columns)
    return np.asarray(estimate, float), np.sqrt(np.diagonal(covariance))


def found_at(
    series: dict[str, FloatArray], estimate: FloatArray, loss: str = MSE
) -> StandardErrors:
    plan = planned(LINE.replace("LOSS", loss))
    data = dataset(series, train=[len(series["u"])])
    weights = {"a": np.array(estimate[0]), "b": np.array(estimate[1])}
    return standard_errors(plan, data, weights)


@pytest.mark.parametrize("loss", [MSE, "{expr: 'mse(z, y)', weight: 30}", "'rmse(z, y)'"])
def test_linear_regression(loss: str) -> None:
    series = line(0.3, seed=1)
    estimate, expected = by_the_book(series)
    text = LINE.replace("LOSS", loss).replace("optimizer: levenberg_marquardt", "epochs: 1")
    data = dataset(series, train=[60])
    weights = {"a": np.array(estimate[0]), "b": np.array(estimate[1])}
    found = standard_errors(planned(text), data, weights)
    assert found.errors["a"] == pytest.approx(expected[0], rel=1e-9)
    assert found.errors["b"] == pytest.approx(expected[1], rel=1e-9)
    assert found.residuals == 60
    assert found.unidentified == ()


def test_more_slopes_than_can_be_computed_in_time_have_a_reason(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The slopes of an arm's step take a minute, and their kernel more stack than there is."""
    series = line(0.3, seed=1)
    operations = len(planned(LINE.replace("LOSS", MSE)).rollout.program.step)
    monkeypatch.setattr(module, "MOST_SLOPES", 2 * operations)
    assert found_at(series, np.array([0.7, 2.0])).reason is None
    monkeypatch.setattr(module, "MOST_SLOPES", 2 * operations - 1)
    found = found_at(series, np.array([0.7, 2.0]))
    assert found.errors == {}
    assert found.reason is not None
    assert found.reason.startswith(f"slopes of {operations} operations in 2 numbers are more than")


RIDGE = """
msnn: 1
name: ridge
inputs: {u: 1}
targets: {y: 1}
parameters: {a: {init: 1, scale: 2}, b: 0.5}
outputs: {z: {expr: a * u + b}}
losses: {fit: 'MEASURE'}
train: [{engine: torch, optimizer: OPTIMIZER, weight_decay: 0.1}]
"""
AS_LOSSES = {
    "losses: {": "losses: {of_a: {expr: 'l2(a / 2)', weight: 0.05}, "
    "of_b: {expr: l2(b), weight: 0.05}, ",
    ", weight_decay: 0.1": "",
}


def at_the_ridge(text: str, series: dict[str, FloatArray]) -> tuple[StandardErrors, FloatArray]:
    """The errors at the minimum of mse + 0.05 (a²/4 + b²), and those of Hoerl and Kennard."""
    columns = np.stack([series["u"], np.ones_like(series["u"])], axis=1)
    rows, products = len(columns), columns.T @ columns
    inverse = np.linalg.inv(products + rows * 0.05 * np.diag([0.25, 1.0]))
    estimate = inverse @ columns.T @ series["y"]
    squares = float(np.sum((series["y"] - columns @ estimate) ** 2))
    variance = squares / (rows - np.trace(inverse @ products))
    weights = {"a": np.array(estimate[0]), "b": np.array(estimate[1])}
    found = standard_errors(planned(text), dataset(series, train=[rows]), weights)
    return found, np.sqrt(np.diagonal(variance * inverse @ products @ inverse))


@pytest.mark.parametrize("measure", ["mse(z, y)", "huber(z, y, delta=9)"])
@pytest.mark.parametrize(
    "optimizer",
    ["levenberg_marquardt", "lbfgs", "adam", "sgd", "{torch: {name: RAdam}}"],
)
def test_weight_decay_and_the_same_penalties_as_losses_have_the_same_errors(
    optimizer: str, measure: str
) -> None:
    series = line(0.3, seed=1)
    text = RIDGE.replace("OPTIMIZER", optimizer).replace("MEASURE", measure)
    found, expected = at_the_ridge(text, series)
    for before, after in AS_LOSSES.items():
        text = text.replace(before, after)
    spelt, _ = at_the_ridge(text, series)
    assert found.covariance is not None
    assert spelt.covariance is not None
    assert found.errors["a"] == pytest.approx(spelt.errors["a"], rel=1e-12)
    assert found.errors["b"] == pytest.approx(spelt.errors["b"], rel=1e-12)
    assert found.covariance.matrix == pytest.approx(spelt.covariance.matrix, rel=1e-12)
    assert found.noise["fit"] == pytest.approx(spelt.noise["fit"], rel=1e-12)
    if measure.startswith("mse"):
        assert [found.errors["a"], found.errors["b"]] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    "optimizer",
    [
        "adamw",
        "{torch: {name: AdamW}}",
        "{torch: {name: NAdam, options: {decoupled_weight_decay: true}}}",
    ],
)
def test_errors_beside_decoupled_decay_are_those_of_the_losses(optimizer: str) -> None:
    series = line(0.3, seed=1)
    text = RIDGE.replace("MEASURE", "mse(z, y)").replace("OPTIMIZER", optimizer)
    found, _ = at_the_ridge(text, series)
    alone, _ = at_the_ridge(text.replace(", weight_decay: 0.1", ""), series)
    assert found.errors == alone.errors


def test_the_95_percent_interval_covers_the_truth_95_percent_of_the_time() -> None:
    inside = 0
    for seed in range(120):
        series = line(0.3, seed)
        estimate, _ = by_the_book(series)
        found = found_at(series, estimate)
        inside += abs(estimate[0] - 0.7) < 1.96 * found.errors["a"]
    # 120 draws at 95 %: three standard deviations of their number are 7.2
    assert abs(inside - 114) <= 7


@pytest.mark.parametrize(("measure", "share"), [("mse", 1.0), ("rmse", 5.0)])
def test_two_losses_with_noise_of_their_own(measure: str, share: float) -> None:
    """Each loss has its σ; what a badly weighted sum loses shows in the error.

    Near its minimum of 0.1 a root has the slope 1 / (2 · 0.1) in the mean square.
    """
    text = (
        "msnn: 1\nname: two\ninputs: {u: 1}\ntargets: {y: 1, z: 1}\nparameters: {a: 1}\n"
        "outputs: {p: {expr: a * u}}\n"
        "losses: {fine: 'MEASURE(p, y)', coarse: {expr: 'mse(p, z)', weight: WEIGHT}}\n"
        "train: [{engine: torch, epochs: 1}]\n"
    )
    random = np.random.default_rng(4)
    u = np.ones(4000)
    series = {"u": u, "y": random.normal(1, 0.1, 4000), "z": random.normal(1, 2.0, 4000)}
    for weight in (0.0001, 1.0, 5.0):
        found = standard_errors(
            planned(text.replace("WEIGHT", str(weight)).replace("MEASURE", measure)),
            dataset(series, train=[4000]),
            {"a": np.array(1.0)},
        )
        # a is the weighted mean of both: the spread of that mean is known
        ratio = weight / share
        expected = np.sqrt(0.1**2 + ratio**2 * 2.0**2) / (1 + ratio) / np.sqrt(4000)
        assert found.errors["a"] == pytest.approx(expected, rel=0.05)


def beside_the_bound(intercept: float, b: float) -> tuple[StandardErrors, list[str]]:
    """y = 0.7 u + intercept, with b beside its bounds 0 … 9 and a where it belongs."""
    series = line(0.3, seed=1)
    series["y"] += intercept - 2.0
    a = float(series["u"] @ (series["y"] - b) / (series["u"] @ series["u"]))
    found = found_at(series, np.array([a, b]))
    plan = planned(LINE.replace("LOSS", MSE))
    weights = {"a": np.array(a), "b": np.array(b)}
    warnings = parameter_warnings(plan.rollout.program, weights, found)
    return found, [f"{w.code} {w.help}" for w in warnings]


@pytest.mark.parametrize("b", [0.0, 1e-9, 4e-4])
def test_a_number_at_its_bound_has_no_error_and_takes_no_freedom(b: float) -> None:
    found, warnings = beside_the_bound(-3.0, b)
    assert np.isnan(found.errors["b"])
    assert np.isfinite(found.errors["a"])
    assert warnings == ["W0904 the true value may lie beyond it"]


@pytest.mark.parametrize("b", [0.0, 1e-9, 4e-4, 8.9999, 9.0])
def test_a_number_that_got_stuck_at_a_bound_is_said_to_be_no_minimum(b: float) -> None:
    """The loss falls away from the bound: nothing says that the true value is beyond it."""
    _, warnings = beside_the_bound(4.0, b)
    (warning,) = warnings
    assert warning.startswith("W0914 train on with `levenberg_marquardt`")


def test_a_minimum_right_beside_a_bound_has_its_error() -> None:
    series = line(0.3, seed=1)
    (_, intercept), errors = by_the_book(series)
    series["y"] -= intercept - 1e-7
    (a, b), _ = by_the_book(series)
    assert b == pytest.approx(1e-7, rel=1e-3)
    found = found_at(series, np.array([a, b]))
    assert found.errors["b"] == pytest.approx(errors[1], rel=1e-6)


@pytest.mark.parametrize(
    ("low", "high", "side"), [(0.0, None, 1), (None, 0.0, -1), (0.0, 1000.0, 1)]
)
def test_a_small_number_is_at_its_bound_by_the_way_that_it_had(
    low: float | None, high: float | None, side: int
) -> None:
    """A rate per second that begins at 3e-6 is no thousandth of its scale 1."""
    initial = (side * 3e-6,) * 3
    learned = Parameter("k", (Axis("of", 3),), initial=initial, minimum=low, maximum=high)
    found = is_near_bound(learned, side * np.array([5.5e-6, 4e-9, 2e-9]))
    assert found.tolist() == [False, False, True]


def test_what_the_data_do_not_determine_is_named() -> None:
    text = (
        "msnn: 1\nname: twins\ninputs: {u: 1}\ntargets: {y: 1}\n"
        "parameters: {a: 0.5, b: 0.1, c: 7, d: 1}\n"
        "outputs: {z: {expr: (a + 2 * b) * u + 0 * c + d}}\nlosses: {fit: 'mse(z, y)'}\n"
        "train: [{engine: torch, epochs: 1}]\n"
    )
    series = {"u": np.linspace(-1, 1, 30), "y": np.linspace(-2, 2.1, 30) ** 2}
    plan = planned(text)
    program = plan.rollout.program
    weights = {p.name: np.array(p.initial[0]) for p in program.parameters}
    found = standard_errors(plan, dataset(series, train=[30]), weights)
    together = next(change for change in found.unidentified if len(change) == 2)
    assert together["a"] == pytest.approx(1.0)
    assert together["b"] == pytest.approx(-0.5)
    assert {"c": 1.0} in found.unidentified
    assert np.isfinite(found.errors["d"])
    assert all(np.isnan(found.errors[name]) for name in "abc")
    warnings = parameter_warnings(program, weights, found)
    assert [w.code for w in warnings] == ["W0930", "W0930"]
    assert any("a +1, b -0.5" in w.notes[0] for w in warnings)
    assert {w.message for w in warnings} == {
        "`a` and `b` show only in combination in the training data",
        "`c` does not show in the training data",
    }
    assert (
        parameters_table(parameters_record(program, weights, found)).count("not identifiable") == 3
    )


def test_zeros_that_a_penalty_made_are_not_called_unidentifiable() -> None:
    entry = {
        "name": "f.weight",
        "unit": None,
        "initial": [0.1, 0.1],
        "values": [0.0, 0.5],
        "learn": True,
        "at_bound": False,
        "standard_errors": [None, 0.01],
    }
    zero = [{"array": "f.weight", "over": "t", "of": 2, "zero": [0]}]
    said = parameters_table({"parameters": [entry], "zero_slices": zero})
    assert "not identifiable" not in said
    # without the penalty, or of another number, it is what the data do not determine
    assert "not identifiable" in parameters_table({"parameters": [entry]})
    other = {**entry, "standard_errors": [None, None]}
    said = parameters_table({"parameters": [other], "zero_slices": zero})
    assert "not identifiable" in said


def test_what_a_long_window_cannot_tell_apart_is_one_warning() -> None:
    text = (
        "msnn: 1\nname: long\nsample_time: 1 s\ninputs: {u: 1}\ntargets: {y: 1}\n"
        "layers: {h: {fir: {window: 20}}}\noutputs: {z: {expr: h(u)}}\nlosses: {fit: 'mse(z, y)'}\n"
        "train: [{engine: torch, epochs: 1}]\n"
    )
    u = np.sin(0.7 * np.arange(80)) + np.sin(0.2 * np.arange(80))  # four numbers describe it
    plan = planned(text)
    program = plan.rollout.program
    weights = {p.name: np.full(20, 0.1) for p in program.parameters}
    found = standard_errors(plan, dataset({"u": u, "y": u}, train=[80]), weights)
    (warning,) = parameter_warnings(program, weights, found)
    assert warning.message.startswith("20 of the 20 numbers of `h.weight` show only in combination")
    assert warning.notes[0].startswith("16 changes leave every residual as it is, one of them: h.w")
    assert warning.notes[0].count("h.weight[") == 6


def test_overlapping_rollouts_count_a_row_once() -> None:
    """A stride of 1 trains on each row many times, which adds no information."""
    stage = "  - {{rollout: {{horizon: 5, stride: {stride}}}, engine: torch}}\n"
    found: list[StandardErrors] = []
    for stride in (1, 5):
        program, spec = gain(stage.format(stride=stride))
        series = gain_series(61)
        series["x"] += np.random.default_rng(3).normal(0, 0.1, 61)
        (plan,) = plan_stages(program, spec.train, Findings())
        weights = {"a": np.array(0.8), "b": np.array(0.3)}
        found.append(standard_errors(plan, dataset(series, train=[61]), weights))
    assert found[0].residuals == found[1].residuals == 60
    assert found[0].errors == found[1].errors


def test_too_many_numbers_and_losses_without_squares_say_so() -> None:
    assert found_at(line(0.3, 1), np.array([0.7, 2.0]), "'mse(z, y)'").reason is None
    text = LINE.replace("LOSS", "'l2(a)'").replace("levenberg_marquardt", "adam")
    data = dataset(line(0.3, 1), train=[60])
    weights = {"a": np.array(0.7), "b": np.array(2.0)}
    none = standard_errors(planned(text), data, weights)
    assert none.errors == {}
    program, _ = compiled(text)
    assert "no loss is a sum of squares" in str(
        errors_note(parameters_record(program, weights, none))
    )


def test_a_run_keeps_values_with_errors(tmp_path: Path) -> None:
    program, spec = compiled(LINE.replace("LOSS", MSE))
    series = line(0.3, seed=1)
    options = TrainingOptions(runs=tmp_path)
    result = train(program, dataset(series, train=[60]), spec.train, options)
    estimate, expected = by_the_book(series)
    assert result.folder is not None
    kept = json.loads((result.folder / "parameters.json").read_text())
    a, b = kept["parameters"]
    assert (a["name"], a["unit"]) == ("a", "1/s")
    assert a["values"] == pytest.approx([estimate[0]], rel=1e-6)
    assert a["standard_errors"] == pytest.approx([expected[0]], rel=1e-6)
    assert b["standard_errors"] == pytest.approx([expected[1]], rel=1e-6)
    assert kept["standard_errors"]["noise"]["fit"] == pytest.approx(0.3, rel=0.3)


NETWORK = """
msnn: 1
name: network
sample_time: 1 s
inputs: {u: 1}
targets: {y: 1}
parameters: {a: 0.5, b: 0.1}
layers: {net: LAYER, phi: {fuzzify: {centers: [-1, 1]}}}
outputs: {z: {expr: VALUE}}
losses: {fit: 'mse(z, y)'}
train: [{engine: torch, epochs: 1}]
"""


@pytest.mark.parametrize(
    ("layer", "value", "said"),
    [
        ("{mlp: {hidden: [6, 6]}}", "net(u)", None),
        ("{state_space: {order: 3}}", "net(u)", None),
        ("{local_model: {by: phi(u), cell: {mlp: {hidden: [4]}}}}", "net(u)", None),
        ("{mlp: {hidden: [6, 6]}}", "net(u) + (a + 2 * b) * u ** 9", "`a` and `b` show only"),
        ("{mlp: {hidden: [6, 6], bias: true}}", "net(u) + 0 * a", "`a` does not"),
        ("{mlp: {hidden: [6, 6]}}", "net(u) + a", "`a` shows only in combination with `net` in"),
    ],
)
def test_only_what_somebody_reads_is_worth_a_warning(
    layer: str, value: str, said: str | None
) -> None:
    """Every network has numbers that can change together; that alone says nothing."""
    text = NETWORK.replace("LAYER", layer).replace("VALUE", value)
    plan = planned(text)
    _, spec = compiled(text)
    program = plan.rollout.program
    weights = initial_weights(program)
    u = np.linspace(-1, 1, 40)
    found = standard_errors(plan, dataset({"u": u, "y": u}, train=[40]), weights)
    assert found.unidentified
    warnings = parameter_warnings(program, weights, found, black_boxes(spec))
    assert [w.code for w in warnings] == ([] if said is None else ["W0930"])
    assert said is None or said in warnings[0].message


@pytest.mark.parametrize(("scale", "held"), [(1.0, False), (1000.0, True)])
def test_with_one_bound_the_scale_says_what_is_at_it(scale: float, held: bool) -> None:
    program, _ = compiled(
        "msnn: 1\nname: line\ninputs: {u: {}}\n"
        f"parameters: {{k: {{init: 1000, min: 0, scale: {scale}}}}}\noutputs: {{y: k * u}}\n"
    )
    assert bool(is_near_bound(program.parameter("k"), np.array(0.5))) == held

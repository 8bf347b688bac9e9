"""R9: the losses of a spec; what they compare, and what is there without `losses:`."""

import numpy as np
import pytest

from compiler.interpreter.interpreter import Interpreter
from compiler.ir.program import Measure
from compiler.ir.types import Prediction
from msnn.data.rollout_rows import Runs
from msnn.simulation.rollout import loss_sums
from tests.language.compiled import Array, codes, compiled, warnings_of

HEAD = """
inputs: {x: m, u: N}
targets: {z: m}
layers: {h: {fir: {window: 3}}}
outputs:
  x_next: {expr: h(x) + u, predicts: "x[t+1]"}
  zhat: {expr: 2 * x, predicts: z}
  other: x + 1
"""


def test_each_prediction_has_the_default_loss() -> None:
    program = compiled(HEAD)
    assert [(loss.name, loss.measure, loss.weight) for loss in program.losses] == [
        ("x_next", Measure.MSE, 1.0),
        ("zhat", Measure.MSE, 1.0),
    ]
    assert program.output("zhat").predicts == Prediction("z", 0)


def test_with_losses_only_the_listed_ones_count() -> None:
    text = HEAD + 'losses: {only: {expr: "rmse(zhat, z)", weight: 0.1}, size: l2(h(x))}\n'
    losses = compiled(text).losses
    assert [(loss.name, loss.measure, loss.weight) for loss in losses] == [
        ("only", Measure.RMSE, 0.1),
        ("size", Measure.MEAN, 1.0),
    ]


def test_bare_inputs_of_a_loss_are_their_log() -> None:
    """`x` in the loss is the log even when `x` is closed; inside an equation it is what runs."""
    program = compiled(HEAD + 'losses: {a: "mse(x_next, x[t+1])", b: "mse(other, x)"}')
    nodes = program.step
    target = program.losses[1].target
    assert target is not None
    assert type(nodes[target].op).__name__ == "ReadLog"
    assert "ReadSignal" in {type(node.op).__name__ for _, node in nodes}


def test_a_loss_function_is_no_value() -> None:
    assert codes(HEAD + 'losses: {a: "sqrt(mse(x_next, x[t+1]))"}') == ["E0310"]
    assert codes(HEAD + 'losses: {a: "mse(x_next, x) * mae(x, u)"}') == ["E0310"]
    assert codes(HEAD + 'losses: {a: "1 / mse(x_next, x)"}') == ["E0310"]
    assert codes(HEAD + 'losses: {a: "x * mse(x_next, x[t+1])"}') == ["E0309"]
    assert codes(HEAD + 'losses: {a: "mse(x_next, x) / 0"}') == ["E0312"]
    assert codes(HEAD + 'losses: {a: "mse(x_next, x, u)"}') == ["E0305"]
    assert codes(HEAD.replace("other: x + 1", "other: mse(x, u)")) == ["E0310"]


def test_a_sum_of_measures_is_one_loss_of_several_terms() -> None:
    text = (
        HEAD
        + """
constants: {lambda_: 0.1}
losses:
  fit:
    expr: "mse(x_next, x[t+1]) + lambda_ * mae(zhat, z) / 2 - 3 * (l2(h(x)) + mse(other)) + x**2"
    weight: 5
"""
    )
    found = compiled(text).losses
    assert [(loss.name, loss.entry, loss.measure, loss.weight) for loss in found] == [
        ("fit.mse", "fit", Measure.MSE, 5),
        ("fit.mae", "fit", Measure.MAE, 5),
        ("fit.l2", "fit", Measure.MEAN, 5),
        ("fit.mse2", "fit", Measure.MSE, 5),
        ("fit.cost", "fit", Measure.MEAN, 5),
    ]
    assert [loss.share for loss in found] == [1, 0.05, -3, -3, 1]


def values(losses: str, log: dict[str, Array], head: str = "") -> dict[str, float]:
    """Each term over rows 3 … 5 of the log, by the interpreter."""
    head = (
        head
        or """
dims: {c: 3}
inputs: {z: {dims: c}, x: m}
targets: {p: {dims: c}, k: {}}
outputs: {y: 2 * z, f: x + 1}
"""
    )
    judge = Interpreter(compiled(head + losses))
    starts = np.array([3, 4, 5])
    runs = Runs(starts, np.ones(3, dtype=int), 0, 10)
    sums = loss_sums(judge, log, runs)
    return {loss.name: sums[loss.name].value(loss.measure) for loss in judge.program.losses}


GENERATOR = np.random.default_rng(4)
LOG = {
    "z": GENERATOR.normal(size=(8, 3)),
    "x": GENERATOR.normal(size=8),
    "p": GENERATOR.dirichlet([1, 1, 1], size=8),
    "k": GENERATOR.integers(0, 3, size=8).astype(float),
}


def test_a_measure_of_one_value_compares_it_with_zero() -> None:
    found = values("losses: {a: mse(x), b: mae(f), c: rmse(x), d: huber(x)}", LOG)
    x = LOG["x"][3:6]
    size = np.abs(x)
    huber = np.where(size <= 1, x * x / 2, size - 0.5)
    expected = [np.mean(x**2), np.mean(np.abs(x + 1)), np.sqrt(np.mean(x**2)), np.mean(huber)]
    np.testing.assert_allclose(list(found.values()), expected, rtol=1e-14)


@pytest.mark.parametrize(
    ("delta", "value"), [("0.3", 0.3), ("d / 2", 0.35), ("2 * pi", 2 * np.pi), ("w", 0.02)]
)
def test_huber_bends_at_delta_in_the_unit_of_the_difference(delta: str, value: float) -> None:
    """`0.3` is 0.3 m here; a constant with another unit than the difference is refused."""
    head = (
        "inputs: {x: m}\ntargets: {y: m}\nconstants: {d: 0.7, w: {value: 0.02, unit: m}}\n"
        "outputs: {f: {expr: 2 * x, predicts: y}}\n"
    )
    log = {"x": LOG["x"], "y": 3 * LOG["x"][::-1]}
    found = values(f'losses: {{a: "huber(f, y, delta={delta})"}}', log, head)
    error = np.abs(2 * log["x"] - log["y"])[3:6]
    expected = np.where(error <= value, error**2 / 2, value * (error - value / 2))
    assert found["a"] == pytest.approx(np.mean(expected), rel=1e-14)


@pytest.mark.parametrize("measure", ["mse", "rmse", "mae", "huber"])
def test_a_loss_of_two_units_is_a_warning(measure: str) -> None:
    """A distance in m less one in mm is no error of either."""
    text = (
        "inputs: {x: m}\ntargets: {z: mm}\nparameters: {a: {init: 1, unit: m/m}}\n"
        f"outputs: {{f: a * x}}\nlosses: {{fit: '{measure}(f, z)'}}\n"
    )
    assert warnings_of(text) == ["W0504"]
    assert warnings_of(text.replace("z: mm", "z: m")) == []


def test_what_delta_of_huber_cannot_be() -> None:
    text = HEAD + 'losses: {a: "huber(x_next, x[t+1], delta=VALUE)"}\n'
    assert codes(text.replace("VALUE", "0")) == ["E0312"]
    assert codes(text.replace("VALUE", "-0.5")) == ["E0312"]
    assert codes(text.replace("VALUE", "x")) == ["E0309"]
    text = (
        "inputs: {x: m}\ntargets: {y: m}\nconstants: {s: {value: 2, unit: s}}\n"
        "outputs: {f: 2 * x}\nlosses: {a: 'huber(f, y, delta=VALUE)'}\n"
    )
    assert warnings_of(text.replace("VALUE", "s")) == ["W0504"]
    # nothing reads the constant then
    assert warnings_of(text.replace("VALUE", "0.5")) == ["W0301"]
    assert codes(HEAD + 'losses: {a: "huber(x_next, x[t+1], 0.5)"}\n') == ["E0305"]


def test_cross_entropy() -> None:
    found = values('losses: {shares: "cross_entropy(y, p)", number: "cross_entropy(y, k)"}', LOG)
    z = 2 * LOG["z"][3:6]
    log_softmax = z - np.log(np.exp(z).sum(axis=1, keepdims=True))
    by_share = -(LOG["p"][3:6] * log_softmax).sum(axis=1)
    by_number = -log_softmax[np.arange(3), LOG["k"][3:6].astype(int)]
    assert found["shares"] == pytest.approx(by_share.mean(), rel=1e-14)
    assert found["number"] == pytest.approx(by_number.mean(), rel=1e-14)


def test_cross_entropy_of_large_logits_and_missing_targets() -> None:
    log = {**LOG, "z": 1e4 * LOG["z"], "k": LOG["k"].copy(), "p": LOG["p"].copy()}
    log["k"][4] = log["p"][4, 1] = np.nan
    found = values('losses: {shares: "cross_entropy(y, p)", number: "cross_entropy(y, k)"}', log)
    z = 2 * log["z"][[3, 5]]
    largest = z.max(axis=1, keepdims=True)
    log_softmax = z - largest - np.log(np.exp(z - largest).sum(axis=1, keepdims=True))
    by_number = -log_softmax[np.arange(2), log["k"][[3, 5]].astype(int)]
    by_share = -(log["p"][[3, 5]] * log_softmax).sum(axis=1)
    assert found["number"] == pytest.approx(by_number.mean(), rel=1e-12)
    assert found["shares"] == pytest.approx(by_share.mean(), rel=1e-12)


def test_cross_entropy_with_a_simulated_target() -> None:
    found = values('losses: {a: "cross_entropy(y, softmax(z))", b: "cross_entropy(y, p + k)"}', LOG)
    z = LOG["z"][3:6]
    shares = np.exp(z) / np.exp(z).sum(axis=1, keepdims=True)
    log_softmax = 2 * z - np.log(np.exp(2 * z).sum(axis=1, keepdims=True))
    assert found["a"] == pytest.approx(-(shares * log_softmax).sum(axis=1).mean(), rel=1e-13)


def test_cross_entropy_needs_a_vector_and_a_target_that_fits() -> None:
    head = "dims: {c: 3, d: 2}\ninputs: {z: {dims: c}, w: {dims: d}, x: m}\noutputs: {y: z}\n"
    assert codes(head + 'losses: {a: "cross_entropy(x, x)", b: mse(w)}') == ["E0402"]
    assert codes(head + 'losses: {a: "cross_entropy(y, w)", b: mse(x)}') == ["E0402"]

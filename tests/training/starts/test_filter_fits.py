"""R12: `fit:` of `iir` and `state_space`, known before the first stage begins."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from compiler.interpreter.interpreter import Interpreter
from compiler.ir.ops import ReadSignal, ReadState, Reshape
from compiler.ir.program import Graph, Node, Program
from compiler.ir.types import Axis, Prediction, Type
from compiler.ir.verifier import InvalidProgram, verify
from compiler.passes.simplify import drop_unused
from compiler.program_file.file import program_from_data, program_to_data
from msnn.data.dataset import FloatArray
from msnn.model.weights.weights_file import initial_weights
from msnn.training.stage_loss_module import stage_loss
from msnn.training.starts.initial_weights import first_weights
from msnn.training.starts.linear_fit import FilterStructure, UnbrokenRows, fitted_filter
from msnn.training.starts.linear_system import LinearSystem, Triangle
from msnn.training.starts.linear_system import filtered as through
from msnn.training.train import TrainingOptions, train
from spec_schema.diagnostics.diagnostic import SpecError
from tests.language.compiled import codes
from tests.training.cases import compiled, dataset

MODEL = """
msnn: 1
name: filtered
sample_time: 1 s
inputs: {{u: V}}
targets: {{y: m}}
layers: {{f: {layer}}}
outputs: {{z: {{expr: f(u), predicts: "y[t+1]", unit: m}}}}
train: [{{epochs: 2, batch: 8, optimizer: {{adam: {{lr: 0.01}}}}, engine: torch{more}}}]
"""
LAYERS = {
    "iir": "{iir: {num: 2, den: 3, fit: 'y[t+1]'}}",
    "state_space": "{state_space: {order: 3, fit: 'y[t+1]'}}",
    "direct": "{state_space: {order: 3, feedthrough: true, radius: 1, fit: 'y[t+1]'}}",
}


def poles(*values: complex) -> FloatArray:
    return np.asarray(np.real(np.poly(values)), dtype=np.float64)


TRUE = poles(0.9, 0.6 + 0.3j, 0.6 - 0.3j)


def model(layer: str, more: str = "") -> Program:
    return compiled(MODEL.format(layer=layer, more=more))[0]


def filtered(
    numerator: list[float], denominator: FloatArray, rows: int, seed: int = 0
) -> dict[str, FloatArray]:
    """y[t+1] is the filter's response at t to a random u, after a past that is unknown."""
    random = np.random.default_rng(seed)
    u, y = random.normal(size=rows), np.zeros(rows)
    y[:4] = random.normal(size=4)
    for t in range(3, rows - 1):
        y[t + 1] = sum(b * u[t - k] for k, b in enumerate(numerator))
        y[t + 1] -= sum(a * y[t + 1 - j] for j, a in enumerate(denominator) if j)
    return {"u": u, "y": y}


@pytest.mark.parametrize(
    ("kind", "numerator"),
    [
        ("iir", [0.5, -0.2, 0.7]),
        ("state_space", [0.0, 0.5, -0.2, 0.7]),
        ("direct", [0.3, 0.5, -0.2, 0.7]),
    ],
)
def test_a_filter_without_noise_is_recovered(kind: str, numerator: list[float]) -> None:
    program = model(LAYERS[kind])
    parts = [filtered(numerator, TRUE, 80, seed) for seed in (1, 2)]
    data = dataset({n: np.concatenate([p[n][4:] for p in parts]) for n in "uy"}, train=[76, 76])
    weights = first_weights(program, data)
    impulse = {"u": (np.arange(40) == 0).astype(float), "y": np.zeros(40)}
    wanted = np.zeros(40)
    for t in range(40):
        wanted[t] = numerator[t] if t < len(numerator) else 0.0
        wanted[t] -= sum(TRUE[j] * wanted[t - j] for j in (1, 2, 3) if j <= t)
    found = Interpreter(program, weights).rollout(impulse, [0], 40).outputs["z"][0]
    np.testing.assert_allclose(found, wanted, atol=1e-6)


@pytest.mark.parametrize("kind", LAYERS)
@pytest.mark.parametrize("data", ["noise", "unstable", "constant"])
def test_whatever_the_data_the_start_is_stable(kind: str, data: str) -> None:
    rows = 150
    series = filtered([0.5], poles(1.08, 0.5, 0.2), rows)
    if data == "noise":
        series["y"] = np.random.default_rng(5).normal(size=rows)
    if data == "constant":
        series["u"], series["y"] = np.ones(rows), np.ones(rows)
    weights = first_weights(model(LAYERS[kind]), dataset(series, train=[rows]))
    assert all(np.all(np.isfinite(value)) for value in weights.values())
    assert np.all(np.abs(weights["f.reflection"]) < 1)


def test_training_begins_there_for_every_attempt_unless_weights_are_given() -> None:
    program, spec = compiled(MODEL.format(layer=LAYERS["iir"], more=", starts: 2"))
    data = dataset(filtered([0.5, -0.2, 0.7], TRUE, 120), train=[80], val=[40])
    first = first_weights(program, data)
    loss = stage_loss(program, data, spec.train, 0, None)
    np.testing.assert_allclose(loss.weights()["f.num"], first["f.num"], rtol=1e-6)
    drawn = initial_weights(program)
    options = TrainingOptions(runs=None, redrawn=lambda attempt: drawn)
    result = train(program, data, spec.train, options)
    assert np.max(np.abs(result.weights["f.num"] - first["f.num"])) < 0.1
    given = {name: value + 0.25 for name, value in drawn.items()}
    result = train(program, data, spec.train, TrainingOptions(runs=None), weights=given)
    assert np.max(np.abs(result.weights["f.reflection"] - 0.25)) < 0.1


def test_missing_samples_part_the_data() -> None:
    series = filtered([0.5, -0.2, 0.7], TRUE, 120)
    whole = first_weights(model(LAYERS["iir"]), dataset(series, train=[120]))
    series["y"][[0, 41, 42, 80]] = np.nan
    parted = first_weights(model(LAYERS["iir"]), dataset(series, train=[120]))
    np.testing.assert_allclose(parted["f.reflection"], whole["f.reflection"], atol=1e-6)


def test_too_little_data_is_an_error() -> None:
    data = dataset(filtered([0.5], TRUE, 40), train=[8], val=[30])
    with pytest.raises(SpecError, match="E0948"):
        first_weights(model(LAYERS["iir"]), data)


def test_program_files_keep_fits() -> None:
    program = model(LAYERS["direct"])
    (fit,) = program.fits
    assert [node.op for node in fit.argument.nodes] == [ReadSignal("u", 0, 0), Reshape()]
    assert fit.target == Prediction("y", 1)
    assert program_from_data(program_to_data(program), "file") == program


@pytest.mark.parametrize(
    "change",
    [
        {"argument": Graph()},
        {"argument": Graph((Node(ReadSignal("w", 0, 0), (), Type()),))},
        {"argument": Graph((Node(ReadState("f.state"), (), Type((Axis("f.order", 3),))),))},
        {"target": Prediction("w", 1)},
        {"target": Prediction("y", -1)},
        {"den": 65},
        {"den": 0},
        {"radius": 1.5},
        {"layer": "g"},
        {"kind": "iir"},
    ],
)
def test_a_fit_of_nothing_is_no_program(change: dict[str, Any]) -> None:
    program = model(LAYERS["direct"])
    (fit,) = program.fits
    with pytest.raises(InvalidProgram, match=r"fit|no signal `w`"):
        verify(replace(program, fits=(replace(fit, **change),)))


def test_a_filter_of_which_an_array_is_gone_is_no_longer_fitted() -> None:
    """As in a stage whose one loss is a penalty of an array."""
    text = MODEL.format(layer=LAYERS["iir"], more="")
    penalty = text + 'losses: {off: "mse(z, y[t+1])", size: "l2(f.num)"}\n'
    program, _ = compiled(penalty)
    assert [fit.layer for fit in program.fits] == ["f"]
    losses = tuple(loss for loss in program.losses if loss.name == "size")
    left = drop_unused(replace(program, outputs=(), losses=losses))
    assert [parameter.name for parameter in left.parameters] == ["f.num"]
    assert left.fits == ()
    verify(left)


HEAD = """
dims: {joint: 2, wheel: 2}
inputs: {u: V, v: V, q: {dims: joint}}
targets: {y: m, w: {dims: joint}}
states: {x: {next: 0.5 * x + u, init: 0}}
parameters: {k: 2}
equations: {e: k * u + v, late: "e[t-1]"}
layers:
  f: {iir: {num: 1, den: 1, fit: "%s"}}
  g: {state_space: {order: 1, fit: "%s"}}
  s: {state_space: {order: 1, out: joint%s}}
outputs: {o: "%s"}
"""


@pytest.mark.parametrize(
    ("target", "out", "call", "code"),
    [
        ("y[t+1]", "", "f(u) + g(v) + sum(s(u))", ""),
        ("y[t+1]", "", "f(2 * u - v) + f(2 * u - v) + g(e)", ""),
        ("y[t+1]", "", "f(u[t-1]) + f(u[t-1])", ""),
        ("y[t+1]", "", "g(u, v)", ""),
        ("y[t+1]", "", "g(q)", ""),
        ("y[t+1]", "", "g(u, q)", ""),
        ("y[t+1]", ", fit: w", "sum(s(u, v))", ""),
        ("y[t+1]", "", "sum(f(q))", "E0313"),
        ("y[t+1]", "", "f(x)", "E0313"),
        ("y[t+1]", "", "g(u + 0 * x)", "E0313"),
        ("y[t+1]", "", "g(late)", ""),
        ("y[t+1]", "", "f(u) + f(v)", "E0313"),
        ("y[t+1]", "", "g(u, v) + g(v, u)", "E0313"),
        ("y[t+1]", ", fit: y", "sum(s(u))", "E0313"),
        ("w", "", "f(u)", "E0313"),
        ("nothing", "", "f(u)", "E0301"),
        ("e", "", "f(u)", "E0705"),
    ],
)
def test_mistake(target: str, out: str, call: str, code: str) -> None:
    # `f` and `g` have the same target: each says so, whether something calls it or not
    assert set(codes(HEAD % (target, target, out, call))) == ({code} if code else set())


@pytest.mark.parametrize("order", [3, 6])
def test_a_long_record_of_slow_poles_determines_its_filter(order: int) -> None:
    """Power series divided by transforms let roundings grow with the rows until they overflow."""
    rows, true = 20_000, poles(0.99, 0.98, 0.97)
    u = np.random.default_rng(0).normal(size=rows)
    y = filtered_by_recursion(np.convolve(u, [0.0, 1.0, 0.5, 0.2])[:rows], true)
    found = fitted_filter([UnbrokenRows(u, y)], FilterStructure(0, order, order, 1.0))
    assert found is not None
    count = 50
    wanted = filtered_by_recursion(np.eye(count)[1] + 0.5 * np.eye(count)[2], true)
    wanted += filtered_by_recursion(0.2 * np.eye(count)[3], true)
    impulses = np.concatenate((found.numerator, np.zeros(count)))[:count]
    response = filtered_by_recursion(impulses, found.denominator)
    # with poles that cancel the equations are nearly singular: half of the digits are left
    np.testing.assert_allclose(response, wanted, atol=1.5e-8 * np.max(wanted))


def test_many_poles_near_the_limit_stay_a_stable_filter() -> None:
    """Six poles at 1 − 1e-6 are not those of the rounded coefficients; the error overflowed."""
    rows = 20_000
    u = np.random.default_rng(0).normal(size=rows)
    y = filtered_by_recursion(1e-9 * u, poles(*[0.999] * 5))
    found = fitted_filter([UnbrokenRows(u, y)], FilterStructure(0, 6, 6, 1.0, is_direct=True))
    assert found is not None
    assert np.all(np.abs(np.roots(found.denominator)) < 1)
    assert np.any(found.numerator)


def filtered_by_recursion(signal: FloatArray, denominator: FloatArray) -> FloatArray:
    """x[n] = u[n] − Σ aⱼ x[n−j], one number after the other."""
    x = [0.0] * len(signal)
    for n in range(len(x)):
        past = (a * x[n - j] for j, a in enumerate(denominator) if 0 < j <= n)
        x[n] = signal[n] - sum(past)
    return np.array(x)


@pytest.mark.parametrize("order", [0, 1, 3, 6])
@pytest.mark.parametrize("rows", [1, 2, 5, 31, 32, 33, 300])
def test_blocks_compute_what_the_recursion_does(order: int, rows: int) -> None:
    random = np.random.default_rng(order)
    denominator = np.concatenate(([1.0], 0.2 * random.normal(size=order)))
    signal = random.normal(size=rows)
    wanted = filtered_by_recursion(signal, denominator)
    # sums of at most 32 terms of size 1, in another order
    np.testing.assert_allclose(through(signal, denominator), wanted, atol=1e-13)


@pytest.mark.parametrize("columns", [1, 7, 62, 150])
def test_a_triangle_of_many_rows_is_that_of_all_at_once(columns: int) -> None:
    """Tables of any number of rows, also fewer than columns, and longer than what is cut."""
    random = np.random.default_rng(5)
    table = random.normal(size=(9_001, columns)) @ np.diag(np.geomspace(1, 1e-6, columns))
    triangle = Triangle(columns)
    for part in np.split(table, [3, 500, 501, 8_000]):
        triangle.add(part)
    wanted = np.linalg.qr(table, mode="r")
    found = triangle.below(0)
    # rows are determined up to their signs
    signs = np.sign(np.diagonal(found)) * np.sign(np.diagonal(wanted))
    scale = np.linalg.norm(wanted, axis=0)
    np.testing.assert_allclose(signs[:, None] * found / scale, wanted / scale, atol=1e-12)


@pytest.mark.parametrize("rows", [1, 31, 32, 33, 1_500])
def test_states_of_a_linear_system_are_those_step_by_step(rows: int) -> None:
    random = np.random.default_rng(6)
    matrix, drive = 0.4 * random.normal(size=(3, 3)), random.normal(size=(3, 2))
    inputs, start = random.normal(size=(rows, 2)), random.normal(size=3)
    states = [start]
    for u in inputs:
        states.append(matrix @ states[-1] + drive @ u)
    found = LinearSystem(matrix, drive).states(inputs, start)
    np.testing.assert_allclose(found, states, rtol=1e-11, atol=1e-11)

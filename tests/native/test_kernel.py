"""Training kernels against the interpreter: losses, gradients, missing targets, lengths, bits."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from backends.native.kernel import Kernel
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.program import Measure, Program
from compiler.passes.close_loop import close_loop
from tests.conditions import require_tool
from tests.language.compiled import compiled
from tests.native.calculus_models import CALCULUS

Array = NDArray[np.float64]
Rows = NDArray[np.int64]

FIR = """
inputs: {x: m, F: N}
layers: {h_x: {fir: {window: 5}}, h_F: {fir: {window: 3}}}
outputs: {x_next: {expr: h_x(x) + h_F(F), predicts: "x[t+1]"}}
"""
ARM = """
inputs: {u: N}
parameters:
  J: {init: 0.6, min: 0.1}
  c: {init: 0.8, min: 0.1, max: 3}
  k: {init: 4, max: 9}
  w0: 0.1
equations: {torque: u - c*w - k*sin(q) - 0.3*tanh(w / 0.2)}
states:
  q: {der: w, init: q.meas}
  w: {der: torque / J, init: w0}
outputs: {q_next: {expr: next(q), predicts: "q[t+1]"}}
"""
VEHICLE = """
dims: {ch: 4}
inputs: {v: m/s, u: N}
parameters: {c1: -0.02}
layers:
  phi: {fuzzify: {centers: {linspace: [-1, 1, 4]}, dim: ch}}
  lm: {local_model: {by: phi(v), cell: {fir: {window: 6}}}}
outputs: {v_next: {expr: "0.7*v + lm(u) + c1*v**2 + exp(-v*v) * 0.1", predicts: "v[t+1]"}}
"""
JOINTS = """
dims: {joint: 3}
inputs: {q: {dims: joint}, u: {dims: joint}}
parameters: {A: {dims: joint, init: [0.5, 0.6, 0.7]}}
layers: {h: {fir: {window: 4}}}
outputs:
  q_next: {expr: A * q + h(u), predicts: "q[t+1]"}
losses:
  fit: mae(q_next, q[t+1])
  size: {expr: l2(A), weight: 0.05}
"""
MEMORY = """
inputs: {x: m, u: N}
parameters: {a: 0.6, b: 0.3, s0: 0.2}
layers: {h: {fir: {window: 4}}}
states: {s: {next: "a * s + b * u - 0.1 * s[t-2]", init: s0, history: x}}
equations: {e: {expr: "0.5 * e[t-1] + b * s * x", history: 0.1}}
outputs: {x_next: {expr: "h(s) + e + 0.2 * x", predicts: "x[t+1]"}}
"""
FILTERED_JOINTS = """
dims: {joint: 3}
inputs: {q: {dims: joint}, u: {dims: joint}}
layers: {h_q: {fir: {window: 3}}, h_u: {fir: {window: 6}}}
outputs: {q_next: {expr: 0.9 * q + h_q(q) + h_q(sin(q)) + h_u(u), predicts: "q[t+1]"}}
"""
TWO_WINDOWS = """
inputs: {x: m, u: N}
layers: {long: {fir: {window: 6}}, short: {fir: {window: 3}}}
outputs: {x_next: {expr: "long(u) + short(sin(u)) + 0.3 * u[t-4] + 0.5 * x", predicts: "x[t+1]"}}
"""
CLASSES = """
dims: {kind: 3}
inputs: {u: N}
targets: {share: {dims: kind}, number: {}}
layers: {net: {mlp: {hidden: 4, out: kind}}}
outputs: {z: "net(u[t-2], u)"}
losses:
  fit: {expr: "cross_entropy(z, share) - 0.5 * cross_entropy(z, number) + 0.1 * mse(z) / 2"}
"""
KNOWN_CELLS = """
dims: {a: 3, b: 3}
inputs: {u: N, w: N}
targets: {z: m}
layers:
  A: {fuzzify: {centers: {linspace: [-1, 1, 3]}, dim: a}}
  B: {fuzzify: {centers: {linspace: [0, 1, 3]}, dim: b}}
  lm: {local_model: {by: ["A(w)", "B(0.7)"], cell: {fir: {window: 4, bias: true}}}}
outputs: {y: {expr: lm(u), predicts: "z"}}
"""
"""The product that is the gradient of the biases is a factor of that of the weights."""
LEARNED_START = """
inputs: {u: N}
targets: {z: m}
parameters: {x0: 0.1}
layers: {h: {fir: {window: 3}}}
states: {x: {next: h(x) + u, init: x0, history: x0}}
outputs: {y: {expr: next(x), predicts: "z[t+1]"}}
"""
MODELS = {
    "memory": (MEMORY, ("x",)),
    "fir": (FIR, ("x",)),
    "arm": (ARM, ()),
    "vehicle": (VEHICLE, ("v",)),
    "joints": (JOINTS, ("q",)),
    "two_windows": (TWO_WINDOWS, ("x",)),
    "classes": (CLASSES, ()),
    "known_cells": (KNOWN_CELLS, ()),
    "filtered_joints": (FILTERED_JOINTS, ("q",)),
    "learned_start": (LEARNED_START, ()),
    **CALCULUS,
}


def log_of(program: Program, rows: int = 90) -> dict[str, Array]:
    """Smooth random series within ±1."""
    random = np.random.default_rng(5)
    log: dict[str, Array] = {}
    for signal in program.signals:
        shape = tuple(axis.size for axis in signal.axes)
        walk = np.cumsum(random.normal(size=(rows, *shape)), axis=0)
        log[signal.name] = np.sin(0.3 * walk)
    if "number" in log:
        log["number"] = np.rint(1 + log["number"])  # the classes 0, 1 and 2
    return log


def reference(
    program: Program,
    log: dict[str, Array],
    t0: Rows,
    steps: int,
    skip: int,
    weights: dict[str, Array],
) -> tuple[dict[str, float], dict[str, float]]:
    """Sums and counts of every loss, by the interpreter alone."""
    interpreter = Interpreter(program, weights)
    states = interpreter.start(log, t0)
    sums = {loss.name: 0.0 for loss in program.losses}
    counts = dict(sums)
    for number in range(steps):
        values = interpreter.step(log, t0 + number, states)
        states = values.next_states
        if number < skip:
            continue
        for loss in program.losses:
            prediction, target = values.losses[loss.name]
            compared = target is not None and loss.measure is not Measure.MEAN
            error = prediction - target if compared else prediction
            cost = {
                Measure.MSE: lambda e: e * e,
                Measure.RMSE: lambda e: e * e,
                Measure.MAE: np.abs,
                Measure.HUBER: lambda e, d=loss.delta: np.where(
                    np.abs(e) <= d, e * e / 2, d * (np.abs(e) - d / 2)
                ),
                Measure.MEAN: lambda e: e,
            }[loss.measure](error)
            cost = np.broadcast_to(cost, (len(t0), *cost.shape[1:]))
            there = (
                np.ones(cost.shape, bool)
                if target is None
                else ~np.isnan(np.broadcast_to(target, cost.shape))
            )
            sums[loss.name] += float(cost[there].sum())
            counts[loss.name] += int(there.sum())
    return sums, counts


def flat(program: Program, weights: dict[str, Array]) -> Array:
    return np.concatenate([weights[p.name].ravel() for p in program.parameters])


def initial(program: Program) -> dict[str, Array]:
    return {
        p.name: np.reshape(p.initial, tuple(a.size for a in p.axes)) for p in program.parameters
    }


def total(program: Program, sums: dict[str, float], counts: dict[str, float]) -> float:
    value = 0.0
    for loss in program.losses:
        mean = sums[loss.name] / max(counts[loss.name], 1)
        value += loss.weight * (np.sqrt(mean) if loss.measure is Measure.RMSE else mean)
    return value


@pytest.fixture(autouse=True)
def _compiler() -> None:
    require_tool("gcc", install="apt install gcc")


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("steps", [1, 12])
def test_losses_and_gradient_match_the_interpreter(name: str, steps: int) -> None:
    text, closed = MODELS[name]
    program = close_loop(compiled(text), closed)
    log = log_of(program)
    t0 = np.arange(10, 31)  # 21 rollouts: a whole group of lanes and a part of one
    weights = initial(program)
    skip = steps // 4
    kernel = Kernel(program, "float64")
    groups = kernel.groups(t0, np.full(len(t0), steps))
    scale = [loss.weight for loss in program.losses]
    found = kernel.losses(kernel.data(log, skip), groups, flat(program, weights), scale)
    sums, counts = reference(program, log, t0, steps, skip, weights)
    np.testing.assert_allclose(found.sums, list(sums.values()), rtol=1e-12)
    np.testing.assert_array_equal(found.counts, list(counts.values()))
    gradient = differences(program, log, t0, steps, skip, weights)
    # central differences of step 1e-6 keep half of the digits
    np.testing.assert_allclose(found.gradient, gradient, rtol=1e-6, atol=1e-8)


def differences(
    program: Program,
    log: dict[str, Array],
    t0: Rows,
    steps: int,
    skip: int,
    weights: dict[str, Array],
) -> Array:
    slopes: list[float] = []
    for parameter in program.parameters:
        for index in np.ndindex(weights[parameter.name].shape):
            sides: list[float] = []
            for step in (1e-6, -1e-6):
                moved = {name: value.copy() for name, value in weights.items()}
                moved[parameter.name][index] += step
                sides.append(total(program, *reference(program, log, t0, steps, skip, moved)))
            slopes.append((sides[0] - sides[1]) / 2e-6)
    return np.array(slopes)


@pytest.mark.parametrize(
    ("measure", "delta"),
    [*((measure, 1.0) for measure in Measure), (Measure.HUBER, 0.3), (Measure.HUBER, 3.0)],
)
def test_every_measure_and_missing_targets(measure: Measure, delta: float) -> None:
    program = compiled(
        "inputs: {u: N}\ntargets: {z: m}\nparameters: {a: 0.7}\n"
        'outputs: {y: {expr: "a * u + a * a", predicts: "z"}}'
    )
    loss = replace(program.losses[0], measure=measure, delta=delta)
    if measure is Measure.MEAN:
        loss = replace(loss, target=None)
    program = replace(program, losses=(loss,))
    log = log_of(program)
    log["z"][::3] = np.nan
    log["z"] *= 4  # errors on both sides of huber's corner
    t0 = np.arange(0, 37)
    kernel = Kernel(program, "float64")
    groups = kernel.groups(t0, np.full(len(t0), 2))
    found = kernel.losses(kernel.data(log), groups, np.array([0.7]), [1.0])
    weights = initial(program)
    sums, counts = reference(program, log, t0, 2, 0, weights)
    np.testing.assert_allclose(found.sums, list(sums.values()), rtol=1e-13)
    np.testing.assert_array_equal(found.counts, list(counts.values()))
    slope = differences(program, log, t0, 2, 0, weights)
    np.testing.assert_allclose(found.gradient, slope, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("number", [np.nan, 7.5])
def test_what_is_no_class_adds_what_the_judge_says(number: float) -> None:
    """A missing class adds nothing; a number that is none is refused before any training."""
    program = compiled(CLASSES)
    log = log_of(program)
    log["number"][::3] = number
    log["share"][::4, 1] = np.nan
    t0 = np.arange(4, 41)
    kernel = Kernel(program, "float64")
    weights = initial(program)
    groups = kernel.groups(t0, np.full(len(t0), 1))
    scale = [loss.weight for loss in program.losses]
    found = kernel.losses(kernel.data(log), groups, flat(program, weights), scale)
    sums, counts = reference(program, log, t0, 1, 0, weights)
    np.testing.assert_allclose(found.sums, list(sums.values()), rtol=1e-13)
    np.testing.assert_array_equal(found.counts, list(counts.values()))
    slope = differences(program, log, t0, 1, 0, weights)
    np.testing.assert_allclose(found.gradient, slope, rtol=1e-7, atol=1e-9)


def test_float32_is_near_float64() -> None:
    program = close_loop(compiled(VEHICLE), ("v",))
    log = log_of(program)
    t0 = np.arange(10, 60)
    steps = np.full(len(t0), 20)
    parameters = flat(program, initial(program))
    results = []
    for dtype in ("float32", "float64"):
        kernel = Kernel(program, dtype)
        groups = kernel.groups(t0, steps)
        results.append(kernel.losses(kernel.data(log), groups, parameters, [1.0]))
    single, double = results
    np.testing.assert_allclose(single.sums, double.sums, rtol=1e-5)
    scale = np.abs(double.gradient).max()
    np.testing.assert_allclose(single.gradient, double.gradient, atol=1e-5 * scale)


def test_rollouts_of_different_lengths_and_rows_that_count() -> None:
    program = close_loop(compiled(FIR), ("x",))
    log = log_of(program)
    t0, steps = np.array([10, 20, 30, 40, 50]), np.array([3, 9, 3, 9, 5])
    counted = np.random.default_rng(1).random(90) > 0.4
    kernel = Kernel(program, "float64")
    data = kernel.data(log, 0, {"x_next": counted})
    weights = initial(program)
    found = kernel.losses(data, kernel.groups(t0, steps), flat(program, weights), [1.0])
    target = log["x"]
    total_cost, count = 0.0, 0
    for start, length in zip(t0, steps, strict=True):
        runs = Interpreter(program, weights).rollout(log, np.array([start]), int(length))
        rows = np.arange(start, start + length)
        error = runs.outputs["x_next"][0] - target[rows + 1]
        total_cost += float((error**2)[counted[rows]].sum())
        count += int(counted[rows].sum())
    np.testing.assert_allclose(found.sums, [total_cost], rtol=1e-12)
    np.testing.assert_array_equal(found.counts, [count])


def test_denormals_survive_loading_a_kernel() -> None:
    """-ffast-math would link code that flushes them in the whole process."""
    kernel = Kernel(close_loop(compiled(FIR), ("x",)), "float32")
    assert kernel.source.text
    smallest = np.array([1e-310])
    assert (smallest * 0.5)[0] > 0


def test_a_kernel_is_compiled_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MSNN_CACHE", str(tmp_path))
    program = compiled(FIR)
    Kernel(program, "float32")
    stamps = {path.name: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    assert sorted(Path(name).suffix for name in stamps) == [".sha256", ".so"]
    Kernel(program, "float32")
    assert {path.name: path.stat().st_mtime_ns for path in tmp_path.iterdir()} == stamps


def test_several_processes_may_build_one_kernel(tmp_path: Path) -> None:
    code = (
        "from tests.language.compiled import compiled\n"
        "from tests.native.test_kernel import FIR\n"
        "from backends.native.kernel import Kernel\n"
        "assert Kernel(compiled(FIR), 'float32').source.text\n"
    )
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", code],
            cwd=Path(__file__).parents[2],
            env={"MSNN_CACHE": str(tmp_path), "PATH": "/usr/bin:/bin", "PYTHONPATH": "."},
        )
        for _ in range(3)
    ]
    assert [process.wait(timeout=120) for process in processes] == [0, 0, 0]
    assert sorted(path.suffix for path in tmp_path.iterdir()) == [".sha256", ".so"]

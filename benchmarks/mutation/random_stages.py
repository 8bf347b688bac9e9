"""Draws training stages: models, precisions, data from far to exactly what the model predicts."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

import numpy as np

from compiler.interpreter.interpreter import Interpreter
from compiler.ir.program import Program
from compiler.passes.close_loop import close_loop
from msnn.data.dataset import FloatArray
from msnn.data.rollout_rows import Runs
from tests.language.compiled import compiled

_ROWS = 120
_LAYERS = (
    ("fir: {window: W}", "h(A)"),
    ("fir: {window: W, bias: true}", "h(sin(A))"),
    ("mlp: {hidden: [S]}", "h(A, B)"),
    ("mlp: {hidden: [S], activation: relu}", "h(A, B)"),
    ("interpolation: {x: [-1, 0, 1.5], y: [0.1, 0.5, -0.2]}", "h(A)"),
)
_TERMS = (
    "k1 * A",
    "k1 * sin(k2 * A)",
    "tanh(k2 * A) * B",
    "k1 * A * B / (2 + B**2)",
    "max(k1 * A, k2 * B)",
    "where(A > 0.1, k1 * A, k2 * B**2)",
    "k1 * exp(-k2**2 * A**2)",
    "abs(k1 * A - B)",
    "clip(k1 * A, -0.5, k2)",
    "k1 * A[t-2] - k2 * B[t-1]",
    "atan2(k1 * A, 1 + B**2)",
    "sqrt(k2**2 + A**2)",
)
_MEASURES = ("mse", "rmse", "mae", "huber")


@dataclass(frozen=True, slots=True)
class RandomStage:
    """A random training stage: its model, its data and its initial weights."""

    text: str
    program: Program
    dtype: Literal["float32", "float64"]
    log: dict[str, FloatArray]
    runs: Runs
    weights: dict[str, FloatArray]
    second_order: bool


def random_stage(seed: int) -> RandomStage:
    """The random training stage of a seed; its residuals are 0, or from 1e-6 of the signal up to
    its size.
    """
    random = np.random.default_rng((180, seed))
    pick = random.choice
    size = 10.0 ** random.uniform(-3, 5)
    closed = bool(random.random() < 0.6)
    measure = str(pick(_MEASURES, p=[0.55, 0.15, 0.15, 0.15]))
    text = _spec(random, measure)
    program = compiled(text)
    program = close_loop(program, ("x",)) if closed else program
    weights = {
        p.name: np.reshape(p.initial, tuple(a.size for a in p.axes)) * random.uniform(0.7, 1.3)
        for p in program.parameters
    }
    offset = float(pick([0.0, 0.0, 1.0, 30.0]))
    log = {
        "x": np.sin(np.cumsum(random.normal(size=_ROWS)) * 0.3) + offset,
        "u": random.normal(size=_ROWS),
    }
    share = float(pick([0.0, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 1.0]))
    scaled = {
        name: values * (size if random.random() < 0.5 else 1.0) for name, values in log.items()
    }
    scaled["x"] = _followed(program, weights, scaled, share, random)
    horizon = int(pick([1, 2, 5, 20, 50]))
    starts = np.arange(12, _ROWS - horizon - 4)
    runs = Runs(starts, np.full(len(starts), horizon), 0, _ROWS)
    dtype: Literal["float32", "float64"] = "float32" if random.random() < 0.7 else "float64"
    numbers = sum(weight.size for weight in weights.values())
    second = measure in ("mse", "huber") and numbers <= 30 and random.random() < 0.3
    return RandomStage(text, program, dtype, scaled, runs, weights, bool(second))


def _followed(
    program: Program,
    weights: dict[str, FloatArray],
    log: dict[str, FloatArray],
    share: float,
    random: np.random.Generator,
) -> FloatArray:
    """Data of x that the model predicts exactly from the rows before, plus noise of size
    `share`.
    """
    if share == 1.0:
        return log["x"]
    found = {name: values.copy() for name, values in log.items()}
    judge = Interpreter(program, weights)
    level = float(np.abs(log["x"]).max())
    with np.errstate(all="ignore"):
        for t in range(12, _ROWS - 1):
            start = judge.start(found, [t])
            value = float(judge.step(found, [t], start).outputs["x_next"][0])
            value += share * level * random.normal()
            found["x"][t + 1] = np.clip(np.nan_to_num(value), -1e3 * level, 1e3 * level)
    return found["x"]


def _spec(random: np.random.Generator, measure: str) -> str:
    def drawn(template: str) -> str:
        names = ["x", "u"] if random.random() < 0.7 else ["x", "s"]
        random.shuffle(names)
        found = template.replace("A", names[0]).replace("B", names[1])
        return found if "[t-" not in found else found.replace("s[", "u[")

    layer, call = _LAYERS[random.integers(len(_LAYERS))]
    window, units = int(random.integers(1, 14)), int(random.integers(2, 7))
    layer = layer.replace("W", str(window)).replace("S", str(units))
    terms = [
        drawn(str(t)) for t in random.choice(_TERMS, size=random.integers(1, 4), replace=False)
    ]
    state = drawn("u - k2 * s + 0.1 * tanh(x)") if random.random() < 0.5 else None
    parameters = ", ".join(f"k{i}: {random.normal():.3f}" for i in (1, 2))
    changed = f'der: "{state}"' if state and random.random() < 0.5 else 'next: "0.8 * s + k1 * u"'
    whole = " + ".join(
        ["0.9 * x", *terms] + ([f"0.1 * {drawn(call)}"] if random.random() < 0.6 else [])
    )
    # a state that begins anew with each rollout leaves residuals of its own
    whole += " + 0.01 * s" if random.random() < 0.4 or " s" in whole or "(s" in whole else ""
    # a fir that reads s needs its past
    past = ", history: 0.1" if "fir" in layer and re.search(r"h\((s|sin\(s\))", whole) else ""
    return "\n".join(
        [
            "inputs: {x: {}, u: {}}",
            f"parameters: {{{parameters}}}",
            f"layers: {{h: {{{layer}}}}}" if "h(" in whole else "",
            f"states: {{s: {{{changed}, init: 0.1{past}}}}}" if "0.01 * s" in whole else "",
            f'outputs: {{x_next: {{expr: "{whole}", predicts: "x[t+1]"}}}}',
            f'losses: {{fit: "{measure}(x_next, x[t+1])"}}',
            "",
        ]
    )

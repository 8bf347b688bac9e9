"""What the peer offers and no case file shows: loops, losses, draws; values are in `cases/`."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from compiler.interpreter.interpreter import Interpreter
from compiler.passes.close_loop import close_loop
from tests.language.compiled import Array, compiled, simulated

X = np.array([3.0, -1, 4, 1, -5, 9, 2, 6])
Z = np.array([0.5, 2, -2, 1, 3, -1, 0, 4])
T = 4
LOG = {"x": X, "z": Z}
INPUTS = "inputs: {x: m, z: 1}\n"


def exactly(found: Array, expected: ArrayLike) -> None:
    np.testing.assert_array_equal(found, expected)


def test_drawn_initial_values() -> None:
    text = """
dims: {tap: 3}
inputs: {x: m}
parameters: {normal: {dims: tap, init: {normal: {}}}, uniform: {dims: tap, init: {uniform: {}}}}
outputs: {y: sum(normal * uniform) * x}
"""
    program = compiled(text)
    assert len(set(program.parameter("normal").initial)) == 3
    assert all(0 <= value < 1 for value in program.parameter("uniform").initial)


def test_a_gradient_in_a_loss() -> None:
    text = f"{INPUTS}outputs: {{y: z**2 * x}}\nlosses: {{l: 'mse(grad(y, z), x)'}}\n"
    rows = np.array([T])
    judge = Interpreter(compiled(text))
    prediction, target = judge.step(LOG, rows, judge.start(LOG, rows)).losses["l"]
    assert target is not None
    exactly(prediction, [2 * Z[T] * X[T]])
    exactly(target, [X[T]])


def test_closed_loops_and_the_reset_of_states() -> None:
    program = compiled(f"""
{INPUTS}
outputs: {{x_next: {{expr: 0.5 * x + z, predicts: "x[t+1]"}}}}
""")
    found = Interpreter(close_loop(program, ["x"])).rollout(LOG, np.array([0, 3]), 3)
    for start, values in zip((0, 3), found.outputs["x_next"], strict=True):
        x, expected = X[start], []
        for t in range(start, start + 3):
            x = 0.5 * x + Z[t]
            expected.append(x)
        exactly(values, expected)  # the second start begins at its own log, not where one ended
    for init, first in (("3", 3), ("x", X[2]), ("s0", 7)):
        parameter = "parameters: {s0: 7}" if init == "s0" else ""
        text = (
            f"{INPUTS}{parameter}\nstates: {{s: {{next: s + z, init: {init}}}}}\noutputs: {{y: s}}"
        )
        exactly(simulated(text, LOG, 2, 2), [first, first + Z[2]])

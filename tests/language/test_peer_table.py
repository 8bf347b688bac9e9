"""What the peer offers, one test a row of the comparison: its name there, and the values here.

Values come from plain numpy or from counting on paper; `reference_cases/` has the peer's own.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import ArrayLike

from compiler.interpreter.interpreter import Interpreter
from compiler.passes.close_loop import close_loop
from tests.language.compiled import Array, compiled, evaluated, simulated
from tests.language.every_backend import assert_backends_agree

X = np.array([3.0, -1, 4, 1, -5, 9, 2, 6])
Z = np.array([0.5, 2, -2, 1, 3, -1, 0, 4])
T = 4
LOG = {"x": X, "z": Z}
INPUTS = "inputs: {x: m, z: 1}\n"


def value(expression: str, head: str = "", **weights: ArrayLike) -> Array:
    """An expression at row 4; `h__weight` is the weight of the layer h."""
    text = f'{INPUTS}{head}\noutputs: {{y: "{expression}"}}\n'
    return evaluated(text, LOG, T, {n.replace("__", "."): w for n, w in weights.items()})


def exactly(found: Array, expected: ArrayLike) -> None:
    np.testing.assert_array_equal(found, expected)


def closely(found: Array, expected: ArrayLike) -> None:
    np.testing.assert_allclose(found, np.asarray(expected, dtype=float), rtol=1e-12)


@pytest.mark.parametrize(
    ("peer", "here", "rows"),
    [
        ("x.last()", "x", [4]),
        ("x.next()", "x[t+1]", [5]),
        ("x.z(2)", "x[t-2]", [2]),
        ("x.z(-1)", "x[t+1]", [5]),
        ("x.sw(3)", "x.past(3)", [2, 3, 4]),
        ("x.sw([-3, 1])", "x[t-2:t+1]", [2, 3, 4, 5]),
        ("x.sw([1, 3])", "x[t+2:t+3]", [6, 7]),
        ("x.tw(0.3)", "x.past(0.3 s)", [2, 3, 4]),
        ("x.tw([0, 0.2])", "x.future(200 ms)", [5, 6]),
    ],
)
def test_windows(peer: str, here: str, rows: list[int]) -> None:
    del peer
    exactly(np.atleast_1d(value(here)), X[rows])


def test_window_offset() -> None:
    exactly(value("x[t-2:t] - x[t-2]"), X[2:5] - X[2])
    exactly(value("x.past(3) - x"), X[2:5] - X[4])


def test_windows_of_any_stream() -> None:
    exactly(value("e[t-2:t]", "equations: {e: x * z}"), (X * Z)[2:5])
    exactly(value("e[t-3]", "equations: {e: x * z}"), (X * Z)[1])
    exactly(value("e.past(0.2 s)", "equations: {e: x * z}"), (X * Z)[3:5])
    state = "states: {s: {next: s + x, history: 0}}"
    text = f'{INPUTS}{state}\noutputs: {{y: "s[t-1] + 10 * s"}}\n'
    exactly(simulated(text, LOG, 0, 3), [0, 0 + 30, 3 + 20])


def test_parameters_constants_sample_time_and_initialisers() -> None:
    head = """
dims: {tap: 3}
constants: {g: 9.81, table: {value: "[1, 2, 4]", dims: tap}}
parameters:
  k: {init: 2, min: 0, max: 3, unit: N/m}
  listed: {dims: tap, init: [1, 10, 100]}
  indexed: {dims: tap, init: i**2}
  normal: {dims: tap, init: {normal: {}}}
  uniform: {dims: tap, init: {uniform: {}}}
  exp: {dims: tap, init: {exp: {}}}
  negexp: {dims: tap, init: {negexp: {}}}
  lin: {dims: tap, init: {lin: {}}}
"""
    closely(value("g * dt", head), 0.981)
    exactly(value("k * x", head), 2 * X[T])
    exactly(value("sum(listed * table)", head), 1 + 20 + 400)
    exactly(value("0 * x + indexed", head), [0, 1, 4])
    closely(value("0 * x + exp", head), np.exp([0, -1.5, -3]))
    closely(value("0 * x + negexp", head), np.exp([-3, -1.5, 0]))
    exactly(value("0 * x + lin", head), [1, 0.5, 0])
    uniform = value("0 * x + uniform", head)
    assert np.all((uniform >= 0) & (uniform < 1))
    assert len(set(value("0 * x + normal", head))) == 3


def test_fir_linear_dropout_and_shared_weights() -> None:
    head = """
dims: {o: 2}
layers:
  h: {fir: {window: 3, dropout: 0.5}}
  wide: {linear: {out: o}}
"""
    w = np.array([1.0, 10, 100])
    exactly(value("h(x)", head, h__weight=w), w @ X[2:5])  # dropout is for training only
    exactly(value("h(x) - h(z)", head, h__weight=w), w @ X[2:5] - w @ Z[2:5])
    names = [p.name for p in compiled(f"{INPUTS}{head}outputs: {{y: h(x) - h(z)}}").parameters]
    assert names == ["h.weight"]
    v, b = np.array([[1.0, 2], [3, 4]]), np.array([0.5, -0.5])
    found = value("wide(x, z)", head, wide__weight=v, wide__bias=b)
    exactly(found, v @ [X[T], Z[T]] + b)


@pytest.mark.parametrize(
    ("membership", "expected"),
    [
        ("triangular", [0, 2 / 3, 1 / 3]),
        ("rectangular", [0, 1, 0]),
        ("gaussian", None),
        ("{function: bump}", [1 / 17, 1 / 2, 1 / 5]),
    ],
)
def test_fuzzify(membership: str, expected: list[float] | None) -> None:
    for learn in ("false",) if membership == "rectangular" else ("false", "true"):
        head = f"""
functions: {{bump: {{args: d, expr: 1 / (1 + d**2)}}}}
layers: {{phi: {{fuzzify: {{centers: [-1, 2, 5], membership: {membership}, learn: {learn}}}}}}}
"""
        found = value("phi(0 * z + 3)", head)
        if expected is None:
            assert np.argmax(found) == 1
            assert 0 < found[0] < found[2] < found[1]
        else:
            np.testing.assert_allclose(found, expected, atol=1e-9)


def test_local_model_with_several_activations() -> None:
    head = """
dims: {a: 2, b: 3}
layers:
  phi: {fuzzify: {centers: [-6, 10], dim: a}}
  psi: {fuzzify: {centers: [0, 2, 4], dim: b}}
  local: {local_model: {by: [phi(x), psi(z)], cell: {linear: {bias: false}}}}
parameters: {W: {dims: [a, b], init: 1}}
"""
    w = np.arange(6.0).reshape(2, 3) + 1
    share = (X[T] + 6) / 16
    fuzzy = np.outer([1 - share, share], [0, 0.5, 0.5])  # z = 3
    closely(value("local(x)", head, local__weight=w[..., None]), np.sum(w * fuzzy) * X[T])
    found = value("phi(x) @ (psi(z) @ (W * x))", head, W=w)
    closely(found, np.sum(w * fuzzy) * X[T])


def test_functions_with_parameters() -> None:
    head = """
parameters: {p1: 2, p2: 3}
functions: {f: {args: [a, b], expr: p1 * sin(a) + p2 * b}}
"""
    closely(value("f(z, x)", head), 2 * np.sin(Z[T]) + 3 * X[T])
    closely(value("f(z.past(2), x.past(2))", head), 2 * np.sin(Z[3:5]) + 3 * X[3:5])


def test_equation_learner() -> None:
    head = "layers: {e: {equation_learner: {functions: [sin, mul], mix: false}}}"
    weight = np.array([[1.0, 0], [0, 2], [1, 1]])
    u = weight @ [X[T], Z[T]]
    found = value("e(x, z)", head, e__weight_in=weight, e__bias_in=np.zeros(3))
    closely(found, [np.sin(u[0]), u[1] * u[2]])


@pytest.mark.parametrize("learn", ["false", "true"])
def test_interpolation_is_right_between_knots(learn: str) -> None:
    head = f"""
layers:
  line: {{interpolation: {{x: [0, 2, 6], y: [1, 5, 3], learn: {learn}}}}}
"""
    for at, expected in ((-1, 1), (0, 1), (1, 3), (2, 5), (3, 4.5), (6, 3), (9, 3)):
        closely(value(f"line(0 * z + {at})", head), expected)


def test_integrals_and_derivatives_of_time() -> None:
    dt = 0.1
    rows = np.arange(1, 8)
    text = f'{INPUTS}outputs: {{y: "integral(x)"}}\n'
    closely(simulated(text, LOG, 1, 7), dt * np.cumsum(X[1:]))
    text = f'{INPUTS}outputs: {{y: "integral(integral(x, method=trapezoidal))"}}\n'
    steps = dt / 2 * (X[rows] + X[rows - 1])
    closely(simulated(text, LOG, 1, 7), dt * np.cumsum(np.cumsum(steps)))
    closely(value("der(x)"), (X[T] - X[T - 1]) / dt)
    closely(value("der(der(x))"), (X[T] - 2 * X[T - 1] + X[T - 2]) / dt**2)


def test_gradients() -> None:
    closely(value("grad(sin(z) * x, z)"), np.cos(Z[T]) * X[T])
    closely(value("grad(grad(z**3, z), z)"), 6 * Z[T])
    text = f"{INPUTS}outputs: {{y: z**2 * x}}\nlosses: {{l: 'mse(grad(y, z), x)'}}\n"
    program = compiled(text)
    rows = np.array([T])
    judge = Interpreter(program)
    found = judge.step(LOG, rows, judge.start(LOG, rows)).losses["l"]
    prediction, target = found
    assert target is not None
    closely(prediction, [2 * Z[T] * X[T]])
    closely(target, [X[T]])


@pytest.mark.parametrize(
    ("method", "factor"), [("euler", 1.1), ("midpoint", 1.105), ("rk4", 1.1051708333333333)]
)
def test_integrators_with_inputs_and_parameters(method: str, factor: float) -> None:
    text = f"""
{INPUTS}
parameters: {{k: 1}}
states: {{s: {{der: k * s + 0 * x, init: 2}}}}
integrator: {method}
outputs: {{y: next(s)}}
"""
    closely(simulated(text, LOG, 0, 3), 2 * factor ** np.arange(1, 4))
    driven = text.replace("0 * x", "z")
    assert simulated(driven, LOG, 0, 1)[0] > 2 * factor


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


def test_parts_and_joins() -> None:
    head = "dims: {joint: [hip, knee]}\nequations: {q: 'stack(x, z, dim=joint)'}"
    exactly(value("part(q, knee)", head), Z[T])
    exactly(value("part([1, 2, 3] * x, 1)"), 2 * X[T])
    exactly(value("concat(x, [1, 2])"), [X[T], 1, 2])
    exactly(value("concat(x.past(2), z.past(3))"), [*X[3:5], *Z[2:5]])
    exactly(value("stack(x.past(2), z.past(2))"), [X[3:5], Z[3:5]])
    exactly(value("sum(q)", head), X[T] + Z[T])
    exactly(value("sum(stack(x.past(2), z.past(2), dim=joint), over=joint)", head), (X + Z)[3:5])
    exactly(value("sum(x.past(3), over=t)"), np.sum(X[2:5]))


def test_every_row_in_every_backend() -> None:
    text = """
inputs: {x: m, z: 1}
dims: {joint: [hip, knee], a: 2}
parameters: {k: 1}
functions: {f: {args: [p], expr: k * sin(p)}}
layers:
  h: {fir: {window: 3}}
  phi: {fuzzify: {centers: [-6, 10], dim: a}}
  line: {interpolation: {x: [0, 2, 6], y: [1, 5, 3]}}
  learner: {equation_learner: {functions: [sin, mul]}}
states: {s: {der: k * s + z, init: 2}}
integrator: rk4
equations: {e: x * z, q: "stack(x, z, dim=joint)"}
outputs:
  windows: h(x) + sum(e[t-2:t] - e[t-2]) + x[t+1]
  functions: f(z) + line(z) + sum(phi(x)) + sum(learner(x, z))
  calculus: integral(x) + der(z) + grad(sin(z) * x, z)
  parts: part(q, knee) + sum(concat(x.past(2), z))
  flow: next(s)
"""
    assert_backends_agree(text, LOG, [2, 4, 6])

"""R3: operands align by the names of their axes; `@`, sums, `concat` and `stack`."""

import numpy as np
import pytest

from tests.language.compiled import Array, codes, evaluated
from tests.language.every_backend import assert_backends_agree

GENERATOR = np.random.default_rng(3)
Q = GENERATOR.normal(size=(20, 3))
S = GENERATOR.normal(size=20)
HEAD = """
dims: {joint: [a, b, c], row: 3, ch: 2, twin: 2, past: 4}
inputs: {q: {unit: m, dims: joint}, s: m}
constants:
  w: [1, 10, 100, 1000]
  d: {value: [2, 5], dims: ch}
  M: {value: [[1, 2, 3], [4, 5, 6]], dims: [ch, joint]}
  P: {value: [1, 2, 3, 4], dims: past}
  I: {value: eye(3), dims: [row, joint]}
  K: {value: [[1, 2, 3, 4], [5, 6, 7, 8]], dims: [ch, past]}
"""


def value(expression: str) -> Array:
    return evaluated(HEAD + f'outputs: {{y: "{expression}"}}', {"q": Q, "s": S}, 10)


NOW, PAST_Q, PAST_S = Q[10], Q[7:11].T, S[7:11]
M = np.array([[1.0, 2, 3], [4, 5, 6]])
D = np.array([2.0, 5])
W = np.array([1.0, 10, 100, 1000])
K = np.array([[1.0, 2, 3, 4], [5, 6, 7, 8]])


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        ("q * d", NOW[:, None] * D),  # axes of the left operand first
        ("d * q", D[:, None] * NOW),
        ("M * q", M * NOW),
        ("q * M", (M * NOW).T),  # aligned by name, whatever the order
        ("q + s", NOW + S[10]),
        ("w * s.past(4)", W * PAST_S),  # the unnamed axis runs along the window
        ("P * s.past(4)", W * 0 + np.array([1.0, 2, 3, 4]) * PAST_S),  # so does a named one
        ("q.past(4) * s.past(4)", PAST_Q * PAST_S),
        ("M @ q", M @ NOW),
        ("w @ s.past(4)", W @ PAST_S),
        ("K @ (P * s.past(4))", K @ (np.array([1.0, 2, 3, 4]) * PAST_S)),
        ("q.past(4) @ s.past(4)", PAST_Q @ PAST_S),
        ("d @ K", D @ K),
        ("sum(q)", NOW.sum()),
        ("sum(q.past(4))", PAST_Q.sum()),
        ("sum(q.past(4), over=t)", PAST_Q.sum(axis=1)),
        ("sum(q.past(4), over=joint)", PAST_Q.sum(axis=0)),
        ("sum(M * q, over=[joint, ch])", (M * NOW).sum()),
        ("mean(q.past(4), over=joint)", PAST_Q.mean(axis=0)),
        ("mean(M)", M.mean()),
        ("concat(s, 3, s[t-1:t])", np.array([S[10], 3, S[9], S[10]])),
        ("stack(s, 2 * s)", np.array([S[10], 2 * S[10]])),
        ("stack(s, s[t-1], dim=ch)", np.array([S[10], S[9]])),
        ("stack(q, 2 * q, dim=ch)", np.stack([NOW, 2 * NOW])),
        ("stack(1, s, dim=ch) * d", np.array([1, S[10]]) * D),
        ("part(q, b)", NOW[1]),
        ("part(q, 2)", NOW[2]),
        ("part(q.past(4), c)", PAST_Q[2]),
        ("[1, s, 3]", np.array([1, S[10], 3])),
        ("linspace(0, 1, 5)", np.linspace(0, 1, 5)),
        ("arange(2, 4, 0.5)", np.arange(2, 4, 0.5)),
        ("where(q > 0, q, -2)", np.where(NOW > 0, NOW, -2)),
        ("clip(q, -0.5, 0.5)", np.clip(NOW, -0.5, 0.5)),
        ("max(q, s, 0)", np.maximum(np.maximum(NOW, S[10]), 0)),
        ("q**3", NOW**3),
        ("q**-2", NOW**-2.0),
        ("abs(q)**0.5", np.abs(NOW) ** 0.5),
        ("abs(q)**1.7", np.abs(NOW) ** 1.7),
        ("relu(q)", np.maximum(NOW, 0)),
        ("softmax(q)", np.exp(NOW) / np.exp(NOW).sum()),
        ("softmax(1000 * M, over=ch)", np.array([[0.0] * 3, [1.0] * 3])),
        ("softmax(q.past(4))", np.exp(PAST_Q) / np.exp(PAST_Q).sum(axis=0)),
        ("outer(q, d)", np.outer(NOW, D)),
        ("outer(w, s.past(4))", np.outer(W, PAST_S)),
        ("eye(twin, ch) @ d", D),
        ("I @ q", NOW),
        ("smooth_sign(q, 0.1)", np.tanh(NOW / 0.1)),
        ("smooth_sign(q)", np.tanh(NOW)),
        ("elu(q)", np.where(NOW > 0, NOW, np.expm1(NOW))),
    ],
)
def test_r3_value(expression: str, expected: Array) -> None:
    found = value(expression)
    assert found.shape == np.shape(expected)
    # Sums and powers may round differently from numpy's: a few units in the last place.
    np.testing.assert_allclose(found, expected, rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize(
    ("expression", "code"),
    [
        ("s.past(4) + s.past(5)", "E0401"),
        ("M @ s", "E0401"),
        ("stack(s, s, s, dim=ch)", "E0402"),
        ("concat(q, s)", "E0402"),
        ("[q, 1]", "E0402"),
        ("sum(q, over=ch)", "E0406"),
        ("part(q, 3)", "E0408"),
        ("softmax(s)", "E0402"),
        ("softmax(q, over=ch)", "E0406"),
        ("outer(q, q)", "E0402"),
        ("eye(ch, joint) @ q", "E0402"),
        ("eye(ch, 3)", "E0402"),
        ("eye(3)", "E0402"),
        ("eye(ch)", "E0312"),
    ],
)
def test_r3_mistake(expression: str, code: str) -> None:
    assert code in codes(HEAD + f'outputs: {{y: "{expression}"}}')


def test_softmax_reference_case_8() -> None:
    found = value("softmax([-1, 0, 1])")
    # the case is given with seven digits
    np.testing.assert_allclose(found, [0.0900306, 0.2447285, 0.6652409], atol=5e-8)


def test_backends_agree_on_functions_of_axes() -> None:
    outputs = """
outputs:
  a: softmax(q.past(3))
  b: outer(q, d) + smooth_sign(s, 0.3)
  c: eye(twin, ch) @ d
"""
    assert_backends_agree(HEAD + outputs, {"q": Q, "s": S}, [5, 11])

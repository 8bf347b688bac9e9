"""R5: windows of states and equations, and what their samples are before the start."""

import numpy as np
import pytest

from tests.language.compiled import codes, compiled, simulated

RANDOM = np.random.default_rng(5)
X = RANDOM.normal(size=40)
U = RANDOM.normal(size=40)
T0, STEPS = 10, 20


def runs(text: str, expected: np.ndarray, **logs: np.ndarray) -> None:
    found = simulated(text, {"x": X, "u": U, **logs}, T0, STEPS)
    # the same sums in another order
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-13)


def leaky(history: list[float]) -> np.ndarray:
    """s[t0-2], s[t0-1], s[t0] … of the state below."""
    s = [*history, 0.5]
    for step in range(STEPS):
        s.append(0.8 * s[-1] + U[T0 + step])
    return np.array(s)


@pytest.mark.parametrize(
    ("history", "before"), [("0", (0.0, 0.0)), ("3", (3.0, 3.0)), ("x", (X[T0 - 2], X[T0 - 1]))]
)
def test_history_of_a_state(history: str, before: tuple[float, float]) -> None:
    text = f"""
        inputs: {{x: m, u: m}}
        states: {{s: {{unit: m, next: 0.8 * s + u, init: 0.5, history: "{history}"}}}}
        outputs: {{y: "s[t-2] + 10 * s[t-1] + 100 * s", used: x}}
        """
    s = leaky(list(before))
    runs(text, s[:STEPS] + 10 * s[1 : STEPS + 1] + 100 * s[2 : STEPS + 2])


def test_the_log_of_a_measured_state() -> None:
    text = """
        inputs: {x: m, u: m}
        constants: {w: [1, 10, 100]}
        states: {s: {unit: m, next: 0.8 * s + u, init: s.meas}}
        outputs: {y: "sum(w * s[t-2:t])", used: x}
        """
    log = RANDOM.normal(size=40)
    s = [log[T0 - 2], log[T0 - 1], log[T0]]
    for step in range(STEPS):
        s.append(0.8 * s[-1] + U[T0 + step])
    values = np.array(s)
    runs(text, values[:STEPS] + 10 * values[1 : STEPS + 1] + 100 * values[2 : STEPS + 2], s=log)


def test_an_equation_of_inputs_alone_is_evaluated_over_the_log() -> None:
    """`h(x)` has a window of its own, so that its past is kept; A grows by it."""
    text = """
        inputs: {x: m, u: m}
        layers: {h: {fir: {window: 3, init: [1, 2, 3]}}}
        equations: {e: h(x) * u}
        outputs: {y: "e[t-2] + 10 * e"}
        """
    e = np.array([(X[t - 2] + 2 * X[t - 1] + 3 * X[t]) * U[t] for t in range(2, 40)])
    rows = np.arange(T0, T0 + STEPS) - 2
    runs(text, e[rows - 2] + 10 * e[rows])


def test_an_equation_of_states_needs_a_history() -> None:
    text = """
        inputs: {x: m, u: m}
        states: {s: {unit: m, next: 0.8 * s + u, init: 0.5}}
        equations: {e: {expr: s * x, history: 2}}
        outputs: {y: "mean(e[t-1:t])"}
        """
    s = leaky([])
    e = np.concatenate([[2.0], s[:STEPS] * X[T0 : T0 + STEPS]])
    runs(text, (e[:-1] + e[1:]) / 2)
    assert codes(text.replace(", history: 2", "")) == ["E0610"]


def test_an_output_takes_the_log_of_what_it_predicts() -> None:
    text = """
        inputs: {x: m, u: m}
        outputs:
          x_next: {expr: "0.5 * x + u", predicts: "x[t+1]"}
          y: "x_next[t-3] + x_next"
        equations: {unused: x}
        """
    value = 0.5 * X + U
    rows = np.arange(T0, T0 + STEPS)
    # `x_next` reads inputs alone and could be evaluated, but what it predicts was measured
    past = np.where(rows - 3 < T0, X[rows - 3 + 1], value[rows - 3])
    runs(text, past + value[rows])


def test_an_equation_may_read_its_own_past() -> None:
    """A cycle that a past window breaks is no algebraic loop (R4)."""
    text = """
        inputs: {x: m, u: m}
        equations: {e: {expr: "0.5 * e[t-1] - 0.2 * e[t-2] + x + 0 * u", history: 1}}
        outputs: {y: e}
        """
    e = [1.0, 1.0]
    for step in range(STEPS):
        e.append(0.5 * e[-1] - 0.2 * e[-2] + X[T0 + step])
    runs(text, np.array(e[2:]))


def test_vector_equations_with_memory() -> None:
    text = """
        dims: {joint: 3}
        inputs: {x: m, u: m, q: {dims: joint}}
        equations: {e: {expr: "0.5 * e[t-1] + q * x", history: 0}}
        outputs: {y: "sum(e[t-1:t], over=t)", used: u}
        """
    q = RANDOM.normal(size=(40, 3))
    e = [np.zeros(3)]
    for step in range(STEPS):
        e.append(0.5 * e[-1] + q[T0 + step] * X[T0 + step])
    found = simulated(text, {"x": X, "u": U, "q": q}, T0, STEPS)
    np.testing.assert_allclose(found, np.array(e[:-1]) + np.array(e[1:]), rtol=1e-12, atol=1e-13)


def test_a_layer_over_the_past_of_a_state() -> None:
    text = """
        inputs: {x: m, u: m}
        layers: {h: {fir: {window: 3, init: [1, 10, 100]}}}
        states: {s: {unit: m, next: 0.8 * s + u, init: 0.5, history: 0}}
        outputs: {y: h(s), used: x}
        """
    s = leaky([0.0, 0.0])
    runs(text, s[:STEPS] + 10 * s[1 : STEPS + 1] + 100 * s[2 : STEPS + 2])


def test_windows_in_a_vector_field_are_held_over_the_step() -> None:
    text = """
        inputs: {x: m, u: m}
        states: {s: {unit: m, der: "u - s[t-1]", init: 0.5, history: 0}}
        outputs: {y: s, used: x}
        """
    s = [0.0, 0.5]
    for step in range(STEPS):
        s.append(s[-1] + 0.1 * (U[T0 + step] - s[-2]))
    runs(text, np.array(s[1 : STEPS + 1]))


def test_buffers_are_as_long_as_the_longest_use() -> None:
    program = compiled("""
        inputs: {x: m, u: m}
        states: {s: {unit: m, next: 0.8 * s + u, history: 0}}
        outputs: {y: "s[t-2] + sum(s.past(5))", z: "s[t-7] + x"}
        """)
    assert program.state("s.history").axes[-1].size == 7


@pytest.mark.parametrize(
    ("expression", "code"),
    [("s[t+1]", "E0606"), ("s[t-1:t+1]", "E0606"), ("s[t-3]", "E0610")],
)
def test_mistakes(expression: str, code: str) -> None:
    text = "inputs: {u: m}\nstates: {s: {unit: m, next: s + u}}\n"
    assert codes(text + f'outputs: {{y: "sum({expression})"}}') == [code]


@pytest.mark.parametrize("history", ["", ", history: 2"])
def test_a_window_of_one_sample_needs_no_past(history: str) -> None:
    text = f"""
        inputs: {{x: m, u: m}}
        states: {{s: {{unit: m, next: 0.8 * s + u, init: 0.5{history}}}}}
        layers: {{h: {{fir: {{window: 1, init: [3]}}}}}}
        outputs: {{y: h(s), used: x}}
        """
    s = leaky([0.0, 0.0])
    runs(text, 3 * s[2 : STEPS + 2])
    assert not [state for state in compiled(text).states if state.name == "s.history"]


def test_windows_of_one_and_of_three_samples_share_a_buffer() -> None:
    text = """
        inputs: {x: m, u: m}
        states: {s: {unit: m, next: 0.8 * s + u, init: 0.5, history: 2}}
        layers: {h: {fir: {window: 1, init: [3]}}}
        outputs: {y: "h(s) + sum(s.past(3))", used: x}
        """
    s = leaky([2.0, 2.0])
    runs(text, 4 * s[2 : STEPS + 2] + s[1 : STEPS + 1] + s[:STEPS])


def test_a_window_of_one_sample_of_a_window_is_one_of_a_window() -> None:
    text = """
        inputs: {u: m}
        states: {s: {unit: m, next: 0.8 * s + u, history: 0}}
        equations: {w: "s.past(3)"}
        layers: {h: {fir: {window: 1}}}
        outputs: {y: "sum(h(w))"}
        """
    assert codes(text)[:1] == ["E0604"]

"""R8: integrals over time and derivatives with respect to time."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from compiler.interpreter.interpreter import Interpreter
from compiler.passes.simplify import prune_outputs
from tests.language.compiled import Array, codes, compiled, evaluated, simulated

RANDOM = np.random.default_rng(8)
X, U = RANDOM.normal(size=40), RANDOM.normal(size=40)
T0, STEPS, DT = 10, 20, 0.1
ROWS = np.arange(T0, T0 + STEPS)


def of(expression: str, more: str = "", **logs: Array) -> Array:
    text = f'inputs: {{x: m, u: N}}\n{more}\noutputs: {{y: "{expression}", used: x + 0 * u / u}}'
    return simulated(text, {"x": X, "u": U, **logs}, T0, STEPS)


def close(found: Array, expected: NDArray[np.float64]) -> None:
    # the same sums in another order
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    "expression",
    [
        "integral(der(x))",
        "integral(der(x, method=trapezoidal), method=trapezoidal)",
    ],
)
def test_the_integral_of_a_derivative_is_the_change(expression: str) -> None:
    close(of(expression), X[ROWS] - X[T0 - 1])


def test_the_derivative_of_an_integral_is_the_value() -> None:
    close(of("der(integral(x))"), X[ROWS])
    # the trapezoidal one too where the value before t0 is 0, as d[t0-1] is
    text = 'inputs: {x: m}\noutputs: {y: "der(I, method=trapezoidal)"}\n'
    text += 'equations: {I: "integral(x, method=trapezoidal)"}'
    log = np.array([0.0, 0, 14, 1, 2, 3, 4, 5, 6, 7, 8, 9])
    np.testing.assert_allclose(simulated(text, {"x": log}, 2, 10), log[2:], rtol=1e-11)


def test_an_integral_starts_at_init_every_time() -> None:
    close(of("integral(x, init=3)"), 3 + DT * np.cumsum(X[ROWS]))
    close(of("integral(x, init=x[t-1] * 2)"), 2 * X[T0 - 1] + DT * np.cumsum(X[ROWS]))


def test_several_in_one_expression() -> None:
    """Equal ones are one state, others have their own."""
    total, other = DT * np.cumsum(X[ROWS]), DT * np.cumsum(U[ROWS])
    close(
        of("integral(x) * integral(u) + integral(x) + integral(x, init=1)"),
        total * other + 2 * total + 1,
    )
    program = compiled("""
        inputs: {x: m, u: N}
        outputs: {y: "integral(x) * integral(u) + integral(x) + integral(x, init=1)"}
        """)
    assert len(program.states) == 3


def test_windows_by_a_named_equation() -> None:
    more = "equations: {area: {expr: integral(x), history: 5}}"
    total = np.concatenate([[5.0, 5.0], DT * np.cumsum(X[ROWS])])
    close(of("sum(area[t-2:t])", more), total[:-2] + total[1:-1] + total[2:])


def test_the_last_integral_needs_no_history() -> None:
    more = "equations: {area: 'integral(x, init=2)'}"
    total = np.concatenate([[2.0], 2 + DT * np.cumsum(X[ROWS])])
    close(of("area[t-1]", more), total[:-1])


def test_in_equations_states_and_vectors() -> None:
    text = """
        dims: {joint: 3}
        inputs: {q: {dims: joint}}
        states: {s: {dims: joint, next: "integral(q) + 0.5 * s"}}
        outputs: {y: s}
        """
    q = RANDOM.normal(size=(40, 3))
    s, total = np.zeros(3), np.zeros(3)
    found = simulated(text, {"q": q}, T0, STEPS)
    for step in range(STEPS):
        close(found[step], s)
        total = total + DT * q[T0 + step]
        s = total + 0.5 * s


def test_in_a_vector_field_an_integral_is_held_over_the_step() -> None:
    more = "states: {s: {der: integral(x)}}"
    slopes = DT * np.cumsum(X[ROWS])
    close(of("s", more), np.concatenate([[0.0], DT * np.cumsum(slopes)[:-1]]))


def test_a_derivative_is_0_where_the_past_is_not_known() -> None:
    more = "states: {s: {unit: m, next: 0.5 * s + x, init: 3}}"
    s = [3.0]
    for row in ROWS[:-1]:
        s.append(0.5 * s[-1] + float(X[row]))
    expected = np.diff(s, prepend=s[0]) / DT
    close(of("der(s)", more), expected)
    close(of("der(der(s))", more), np.diff(expected, prepend=0.0) / DT)
    close(of("integral(der(s))", more), np.array(s) - 3)
    both = np.array(s) + np.concatenate([[s[0]], s[:-1]])
    close(of("integral(s, method=trapezoidal)", more), DT / 2 * np.cumsum(both))


@pytest.mark.parametrize(
    ("history", "before"), [("history: 1", 1.0), ("history: x", X[T0 - 1]), ("init: s.meas", 7.0)]
)
def test_a_derivative_knows_a_history_and_a_log(history: str, before: float) -> None:
    init = "" if "init" in history else ", init: 3"
    more = f"states: {{s: {{unit: m, next: 0.5 * s + x{init}, {history}}}}}"
    s = [7.0 if "meas" in history else 3.0]
    for row in ROWS[:-1]:
        s.append(0.5 * s[-1] + float(X[row]))
    close(of("der(s)", more, s=np.full(40, 7.0)), np.diff(s, prepend=before) / DT)


def test_an_equation_takes_its_history() -> None:
    more = "equations: {e: {expr: 2 * x * z, history: 4}}\nstates: {z: {next: 1, init: 1}}"
    close(of("der(e)", more), np.diff(2 * X[ROWS], prepend=4.0) / DT)


def test_a_derivative_through_a_layer_with_memory() -> None:
    more = "layers: {h: {iir: {num: 0, den: 1}}}"
    program = compiled(f'inputs: {{x: m, u: N}}\n{more}\noutputs: {{y: "der(h(x)) + 0 * u"}}')
    weights = {"h.num": np.array([1.0]), "h.reflection": np.array([-0.5])}
    found = Interpreter(program, weights).rollout({"x": X, "u": U}, np.array([T0]), STEPS)
    h = [X[T0]]
    for row in ROWS[1:]:
        h.append(0.5 * h[-1] + X[row])
    close(found.outputs["y"][0], np.diff(h, prepend=h[0]) / DT)


def test_the_derivative_of_a_continuous_state_is_its_right_hand_side() -> None:
    more = 'states: {v: {unit: m/s, der: "u - 2 * v", init: 1}, p: {unit: m, der: v}}'
    v = of("v", more)
    close(of("der(v)", more), U[ROWS] - 2 * v)
    close(of("der(p)", more), v)
    close(of("der(der(p))", more), np.diff(v, prepend=v[0]) / DT)
    close(of("f(v)", more + '\nfunctions: {f: {args: [a], expr: "der(a)"}}'), U[ROWS] - 2 * v)


def test_a_right_hand_side_may_read_another_one() -> None:
    more = """
states:
  v: {unit: m/s, der: "u - 2 * v - 0.5 * der(p)"}
  p: {unit: m, der: "3 * v"}
"""
    plain = more.replace("der(p)", "3 * v")
    close(of("v", more), of("v", plain))
    assert codes('inputs: {u: N}\nstates: {v: {der: "u - der(v)"}}\noutputs: {y: v}') == ["E0702"]


def test_windows_and_shifts_of_derivatives_of_logged_signals() -> None:
    d = np.diff(X) / DT  # d[k] belongs to row k+1
    close(of("der(x)[t-3]"), d[ROWS - 4])
    close(of("sum(der(x).past(3))"), d[ROWS - 1] + d[ROWS - 2] + d[ROWS - 3])
    close(of("mean(der(x.past(2)))"), (d[ROWS - 1] + d[ROWS - 2]) / 2)


def test_central_and_forward_differences_of_the_log() -> None:
    text = """
        inputs: {x: m}
        targets: {v: m}
        states: {s: {unit: m/s, next: 0.5 * s + 0 * x, init: "der(x, method=METHOD)"}}
        outputs: {y: s}
        losses: {l: "l1(der(v.meas, method=METHOD))"}
        """
    central = text.replace("METHOD", "central")
    forward = text.replace("METHOD", "forward")
    log = {"x": X, "v": U}
    for spec, slope in (
        (central, lambda s: (s[T0 + 1] - s[T0 - 1]) / (2 * DT)),
        (forward, lambda s: (s[T0 + 1] - s[T0]) / DT),
    ):
        program = compiled(spec)
        interpreter = Interpreter(program)
        rows = np.array([T0])
        step = interpreter.step(log, rows, interpreter.start(log, rows))
        assert step.outputs["y"][0] == pytest.approx(slope(X), rel=1e-13)
        assert step.losses["l"][0][0] == pytest.approx(abs(slope(U)), rel=1e-13)


def test_the_trapezoidal_derivative_rings() -> None:
    """What the documentation warns of: a jump is answered by ± for ever."""
    step = np.concatenate([np.zeros(5), np.ones(8)])
    text = 'inputs: {x: m}\noutputs: {y: "der(x, method=trapezoidal)"}'
    found = simulated(text, {"x": step}, 4, 8)
    np.testing.assert_allclose(found, [0, 20, -20, 20, -20, 20, -20, 20], rtol=1e-12)


def test_units() -> None:
    program = compiled("""
        inputs: {x: m}
        outputs: {a: integral(x), v: der(x), b: "integral(x, method=trapezoidal)"}
        """)
    units = {o.name: program.step[o.node].type.unit for o in program.outputs}
    assert {name: unit.text for name, unit in units.items() if unit} == {
        "a": "m*s", "v": "m/s", "b": "m*s",
    }  # fmt: skip


def test_memory_of_losses_alone_may_read_the_log() -> None:
    text = """
        inputs: {x: m, u: N}
        targets: {z: m}
        equations: {e: integral(z) - integral(y)}
        outputs: {y: 2 * x + 0 * u}
        losses: {drift: "mse(e, 0)"}
        """
    program = compiled(text)
    log = {"x": X, "u": U, "z": RANDOM.normal(size=40)}
    interpreter = Interpreter(program)
    states = interpreter.start(log, np.array([T0]))
    total = 0.0
    for row in ROWS:
        step = interpreter.step(log, np.array([row]), states)
        total += DT * (log["z"][row] - 2 * X[row])
        prediction = step.losses["drift"][0][0]
        assert prediction == pytest.approx(total, rel=1e-11)
        states = step.next_states
    assert not prune_outputs(program, ["y"]).states
    rollout = interpreter.rollout({"x": X, "u": U}, np.array([T0]), STEPS)
    close(rollout.outputs["y"][0], 2 * X[ROWS])
    wrong = text.replace("y: 2 * x", "y: integral(z) + 2 * x")
    assert codes(wrong) == ["E0609"]


def test_a_constant_and_a_shadowed_name() -> None:
    assert evaluated("inputs: {x: m}\noutputs: {y: der(3) + 0 * x}", {"x": X}, T0) == 0
    own = "inputs: {x: m}\nfunctions: {der: {args: [a], expr: 5 * a}}\noutputs: {y: der(x)}"
    assert evaluated(own, {"x": X}, T0) == 5 * X[T0]

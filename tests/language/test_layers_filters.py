"""`iir` and `state_space`: values against plain numpy, stability, starts, in every backend."""

from collections.abc import Mapping

import numpy as np
import pytest

from tests.language.compiled import Array, codes, compiled, simulated
from tests.language.every_backend import assert_backends_agree

GENERATOR = np.random.default_rng(21)
LOG = {
    "x": GENERATOR.normal(size=60),
    "v": GENERATOR.normal(size=60),
    "q": GENERATOR.normal(size=(60, 2)),
}
X = LOG["x"]
HEAD = """
dims: {joint: 2, o: 3, ch: 2}
inputs: {x: m, v: m, q: {unit: rad, dims: joint}}
layers:
  h: {iir: {num: 2, den: 3}}
  lag: {iir: {num: 0, den: 1}}
  rest: {iir: {num: 1, den: 2, init: x}}
  each: {iir: {num: 1, den: 1}}
  ss: {state_space: {order: 3, out: o, feedthrough: true, radius: 0.9}}
  started: {state_space: {order: 2, init: "[1, 2]"}}
  phi: {fuzzify: {centers: [-1, 1], dim: ch}}
  local: {local_model: {by: phi(v), cell: {iir: {num: 1, den: 2}}}}
"""


def run(
    expression: str,
    given: Mapping[str, Array] | None = None,
    *,
    steps: int = 20,
    t0: int = 0,
    **weights: Array,
) -> Array:
    both = {**weights, **(given or {})}
    named = {name.replace("__", "."): array for name, array in both.items()}
    return simulated(HEAD + f'outputs: {{y: "{expression}"}}', LOG, t0, steps, named)


def denominator(reflection: Array) -> Array:
    """1, a₁, … by Levinson's recursion on whole polynomials."""
    polynomial = np.ones(1)
    for r in reflection:
        longer = np.append(polynomial, 0.0)
        polynomial = longer + r * longer[::-1]
    return polynomial


def filtered(b: Array, a: Array, x: Array) -> Array:
    """The difference equation y[t] = Σ b x − Σ a y, started at 0."""
    y = np.zeros(len(x))
    for t in range(len(x)):
        y[t] = sum(b[k] * x[t - k] for k in range(len(b)) if t >= k)
        y[t] -= sum(a[j] * y[t - j] for j in range(1, len(a)) if t >= j)
    return y


def test_iir_is_the_difference_equation() -> None:
    b, r = GENERATOR.normal(size=3), np.array([0.7, -0.4, 0.6])
    expected = filtered(b, denominator(r), X[:20])
    # the other realisation of the same filter, 20 steps
    np.testing.assert_allclose(run("h(x)", h__num=b, h__reflection=r), expected, rtol=1e-11)


def test_iir_of_first_order() -> None:
    found = run("lag(x)", lag__num=np.array([0.2]), lag__reflection=np.array([-0.8]))
    np.testing.assert_allclose(found, filtered(np.array([0.2]), np.array([1, -0.8]), X[:20]))


def test_every_element_has_its_own_filter() -> None:
    b, r = GENERATOR.normal(size=(2, 2)), np.array([[0.5], [-0.5]])
    found = run("each(q)", each__num=b, each__reflection=r)
    for element in range(2):
        expected = filtered(b[element], np.array([1, *r[element]]), LOG["q"][:20, element])
        np.testing.assert_allclose(found[:, element], expected, rtol=1e-11)


def test_iir_at_rest_starts_at_its_gain() -> None:
    b, r = np.array([0.3, 0.4]), np.array([-0.6, 0.3])
    first = run("rest(x)", steps=1, t0=5, rest__num=b, rest__reflection=r)[0]
    np.testing.assert_allclose(first, X[5] * np.sum(b) / np.sum(denominator(r)), rtol=1e-13)


def test_poles_are_stable_for_all_reflection_coefficients() -> None:
    for reflection in GENERATOR.uniform(-1, 1, size=(50, 3)):
        assert np.max(np.abs(np.roots(denominator(reflection)))) < 1
    for name in ("h.reflection", "ss.reflection"):
        program = compiled(HEAD + 'outputs: {y: "h(x)", z: "ss(x)"}')
        parameter = program.parameter(name)
        assert (parameter.minimum, parameter.maximum) == (-1, 1)


def lattice(reflection: Array) -> Array:
    """A for radius 1: the columns are what the layer makes of unit vectors after one step."""
    columns: list[Array] = []
    for unit in np.eye(3):
        spec = """
inputs: {x: m}
layers: {ss: {state_space: {order: 3, radius: 1, init: START}}}
outputs: {y: ss(x)}
""".replace("START", f'"{[float(e) for e in unit]}"')
        rows = [
            simulated(
                spec,
                {"x": [0.0, 0.0, 0.0]},
                0,
                2,
                {
                    "ss.reflection": reflection,
                    "ss.B": np.zeros((3, 1)),
                    "ss.C": np.eye(3)[row],
                },
            )[1]
            for row in range(3)
        ]
        columns.append(np.array(rows))
    return np.stack(columns, axis=1)


def test_state_space_has_the_poles_of_its_reflection_coefficients() -> None:
    reflection = np.array([0.5, -0.3, 0.8])
    matrix = lattice(reflection)
    np.testing.assert_allclose(np.poly(matrix), denominator(reflection), atol=1e-13)
    assert np.linalg.norm(matrix, 2) <= 1 + 1e-12


def test_state_space_is_its_equations() -> None:
    reflection = np.array([0.5, -0.3, 0.8])
    b, c, d = GENERATOR.normal(size=(3, 2)), GENERATOR.normal(size=(3, 3)), np.ones((3, 2))
    found = run("ss(q)", ss__reflection=reflection, ss__B=b, ss__C=c, ss__D=d)
    a, state = 0.9 * lattice(reflection), np.zeros(3)
    for t in range(20):
        u = LOG["q"][t]
        np.testing.assert_allclose(found[t], c @ state + d @ u, rtol=1e-11, atol=1e-12)
        state = a @ state + b @ u


def test_state_space_starts_at_init() -> None:
    found = run("started(x)", steps=1, started__C=np.array([10.0, 1]))
    np.testing.assert_array_equal(found, [12])


def test_one_memory_for_each_signal_and_shared_weights() -> None:
    program = compiled(HEAD + 'outputs: {y: "h(x) + h(v) + h(x)"}')
    assert [state.name for state in program.states] == ["h.state", "h.state2"]
    assert [parameter.name for parameter in program.parameters] == ["h.reflection", "h.num"]
    w = {"h__num": GENERATOR.normal(size=3), "h__reflection": np.array([0.1, 0.2, 0.3])}
    np.testing.assert_allclose(run("h(x) + h(v)", w), run("h(x)", w) + run("h(v)", w), rtol=1e-13)


def test_filters_as_cells() -> None:
    b, r = GENERATOR.normal(size=(2, 2)), GENERATOR.uniform(-0.9, 0.9, size=(2, 2))
    found = run("local(x)", local__num=b, local__reflection=r)
    cells = [filtered(b[i], denominator(r[i]), X[:20]) for i in range(2)]
    upper = np.clip((LOG["v"][:20] + 1) / 2, 0, 1)
    np.testing.assert_allclose(found, (1 - upper) * cells[0] + upper * cells[1], atol=1e-12)


def test_memory_is_held_over_the_step_of_an_integrator() -> None:
    text = """
inputs: {u: m}
layers: {lag: {iir: {num: 0, den: 1}}}
states: {z: {unit: m, der: (lag(u) - z) / 1 s, init: 0}}
integrator: {rk4: {substeps: 2}}
outputs: {y: lag(u), w: next(z)}
"""
    program = compiled(text)
    assert [state.name for state in program.states] == ["z", "lag.state"]
    weights = {"lag.num": np.array([1.0]), "lag.reflection": np.array([-0.5])}
    log = {"u": X}
    held = simulated(text, log, 0, 3, weights)
    z = simulated(text, log, 0, 3, weights, "w")
    # the exact solution of ż = u − z over one step of 0.1 s; rk4 with 2 substeps is within 1e-8
    assert z[0] == pytest.approx(held[0] * (1 - np.exp(-0.1)), rel=1e-6)


def test_past_of_a_filter_is_kept() -> None:
    text = (
        HEAD
        + """
equations: {e: {expr: h(x), history: 0}}
outputs: {y: "e[t-2] + sum(e.past(3))"}
"""
    )
    w = {"h.num": GENERATOR.normal(size=3), "h.reflection": np.array([0.1, 0.2, 0.3])}
    e = np.concatenate([np.zeros(3), run("h(x)", w)])
    expected = [e[t + 1] + e[t + 1] + e[t + 2] + e[t + 3] for t in range(20)]
    np.testing.assert_allclose(simulated(text, LOG, 0, 20, w), expected, atol=1e-13)
    assert_backends_agree(text, LOG, [5, 6])


def test_backends_agree() -> None:
    outputs = """
outputs:
  a: h(x)
  b: rest(x)
  c: each(q)
  d: ss(q)
  e: started(x, v)
  f: local(x)
"""
    assert_backends_agree(HEAD + outputs, LOG, [4, 9, 20])


@pytest.mark.parametrize(
    ("layer", "output", "code"),
    [
        ("{iir: {num: 1}}", "bad(x)", "E0203"),
        ("{iir: {num: 1, den: 0}}", "bad(x)", "E0210"),
        ("{iir: {num: 1, den: 1}}", "sum(bad(x.past(3)))", "E0402"),
        ("{iir: {num: 1, den: 1}}", "bad(x)[t-1]", "E0605"),
        ("{iir: {num: 1, den: 1}}", "bad(x, x)", "E0305"),
        ("{iir: {num: 1, den: 1, init: q}}", "bad(x)", "E0402"),
        ("{iir: {num: 1, den: 1}}", "bad(x) + sum(bad(q))", "E0404"),
        ("{state_space: {order: 0}}", "bad(x)", "E0210"),
        ("{state_space: {order: 2, radius: 1.5}}", "bad(x)", "E0210"),
        ("{state_space: {order: 2, init: '[1, 2, 3]'}}", "bad(x)", "E0402"),
        ("{state_space: {order: 2}}", "bad(M * q)", "E0402"),
        ("{state_space: {order: 2, init: s}}", "bad(x)", "E0704"),
    ],
)
def test_mistake(layer: str, output: str, code: str) -> None:
    spec = f"""
dims: {{joint: 2, o: 3}}
inputs: {{x: m, q: {{unit: rad, dims: joint}}}}
constants: {{M: {{value: [[1, 2], [3, 4], [5, 6]], dims: [o, joint]}}}}
layers: {{bad: {layer}}}
states: {{s: {{next: s + x, init: 0}}}}
outputs:
  y: {output} + x + sum(q) + s
"""
    assert code in codes(spec)


def test_memory_has_no_place_in_losses_and_starts() -> None:
    spec = """
inputs: {x: m}
layers: {h: {iir: {num: 1, den: 1}}}
states: {s: {unit: m, next: s, init: INIT}}
outputs: {y: h(x) + s}
losses: {fit: LOSS}
"""
    fine = spec.replace("INIT", "0").replace("LOSS", '"mse(y, x)"')
    assert codes(fine) == []
    assert "E0310" in codes(spec.replace("INIT", "h(x)").replace("LOSS", '"mse(y, x)"'))
    assert "E0310" in codes(spec.replace("INIT", "0").replace("LOSS", '"mse(y, h(x))"'))

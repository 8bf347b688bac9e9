"""`iir` and `state_space`: stability, memories, mistakes; values are in `cases/`."""

import numpy as np
import pytest

from tests.language.compiled import Array, codes, compiled, simulated

GENERATOR = np.random.default_rng(21)
X = GENERATOR.normal(size=60)
HEAD = """
dims: {o: 3}
inputs: {x: m, v: m}
layers:
  h: {iir: {num: 2, den: 3}}
  ss: {state_space: {order: 3, out: o, feedthrough: true, radius: 0.9}}
"""


def denominator(reflection: Array) -> Array:
    """1, a₁, … by Levinson's recursion on whole polynomials."""
    polynomial = np.ones(1)
    for r in reflection:
        longer = np.append(polynomial, 0.0)
        polynomial = longer + r * longer[::-1]
    return polynomial


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


def test_one_memory_for_each_signal_and_shared_weights() -> None:
    program = compiled(HEAD + 'outputs: {y: "h(x) + h(v) + h(x)"}')
    assert [state.name for state in program.states] == ["h.state", "h.state2"]
    assert [parameter.name for parameter in program.parameters] == ["h.reflection", "h.num"]


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

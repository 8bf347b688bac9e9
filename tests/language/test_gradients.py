"""R8: `grad(y, x)`, the gradient of a value within one sample."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.typing import ArrayLike

from compiler.elaboration.lower_spec import gradient_variables
from compiler.interpreter.interpreter import Interpreter
from spec_schema.reading.reader import read_spec
from tests.language.compiled import Array, codes, compiled, evaluated, simulated

RANDOM = np.random.default_rng(9)
X, Z = RANDOM.uniform(0.2, 1.5, 40), RANDOM.normal(size=40)
T = 10
SIGNALS = "inputs: {x: {unit: 1}, z: {unit: 1}}\n"


FUNCTIONS = """
functions:
  slope: {args: [y, v], expr: "grad(y, v)"}
  twice: {args: [e], expr: "slope(v=e, y=e * (2 * x))"}
  first: {args: [f], expr: "grad(f * f, f)"}
equations: {e: 2 * x, f: 2 * x}"""


def of(expression: str, more: str = "", output: str = "y") -> Array:
    text = f'{SIGNALS}{more}\noutputs: {{y: "{expression}", used: x + z}}'
    return evaluated(text, {"x": X, "z": Z}, T, output=output)


def close(found: Array, expected: ArrayLike) -> None:
    # closed formulas of the same derivative round differently
    np.testing.assert_allclose(found, np.asarray(expected), rtol=1e-12, atol=1e-13)


def test_first_second_and_third_derivatives() -> None:
    x, z = X[T], Z[T]
    close(of("grad(x**3 * z, x)"), 3 * x**2 * z)
    close(of("grad(grad(x**3 * z, x), x)"), 6 * x * z)
    close(of("grad(grad(grad(x**3 * z, x), x), x)"), 6 * z)
    close(of("grad(grad(x**3 * z, x), z)"), 3 * x**2)
    close(of("grad(sin(x) * exp(z), x) - cos(x) * exp(z)"), 0)


def test_a_linear_value_has_the_second_derivative_0() -> None:
    close(of("grad(grad(3 * x, x), x)"), 0)
    close(of("grad(grad(grad(x * z, x), x), x)"), 0)


def test_through_equations_and_outputs() -> None:
    more = "equations: {e: x * z, f: e + x}"
    close(of("grad(f * f, x)", more), 2 * (X[T] * Z[T] + X[T]) * (Z[T] + 1))
    close(of("grad(f * f, e)", more), 2 * (X[T] * Z[T] + X[T]))


def test_an_equation_is_a_variable_of_its_own() -> None:
    """`2 * x` beside e = 2 * x is no use of e, nor is another equation of the same formula."""
    more = "equations: {e: 2 * x, f: 2 * x, g: x}"
    close(of("grad(e * (2 * x), e)", more), 2 * X[T])
    close(of("grad(e * f, e) + 10 * grad(e * f, f)", more), 22 * X[T])
    close(of("grad(g * x, g)", more), X[T])
    close(of("grad(g * x, x)", more), 2 * X[T])


def test_a_variable_may_come_through_functions() -> None:
    """`grad(y, v)` in a formula has the variable that the outermost call gives; R8."""
    close(of("twice(f)", FUNCTIONS), 2 * X[T])
    close(of("twice(e) + slope(e * f, e)", FUNCTIONS), 4 * X[T])
    close(of("first(e)", FUNCTIONS), 4 * X[T])


def test_the_text_shows_which_variables_gradients_have() -> None:
    """An argument hides the equation of its name; what is no bare name is no variable."""
    calls = "twice(f) + first(x) + grad(x * x, x[t-1]) + grad(x, x)"
    text = f'msnn: 1\nname: test\n{SIGNALS}{FUNCTIONS}\noutputs: {{y: "{calls}"}}'
    assert gradient_variables(read_spec("test.yaml", text).spec) == {"f"}


def test_windows_count_with_the_sample_at_t() -> None:
    w = "constants: {w: [1, 10, 100]}\nequations: {e: x * z}"
    close(of("grad(sum(w * x.past(3)), x)", w), 100)
    close(of("grad(x * x[t-1], x)"), X[T - 1])
    close(of("grad(sum(w * e.past(3)) + e * e, e)", w), 100 + 2 * X[T] * Z[T])
    close(of("grad(sum(x.past(3) * x.past(3)) + x, x.past(2))"), [2 * X[T - 1], 2 * X[T] + 1])
    close(of("grad(sum(w * x.past(3)), x.past(3))", w), [1, 10, 100])
    close(of("grad(x * x, x[t-4:t+1])"), [0, 0, 0, 0, 2 * X[T], 0])


def test_windows_and_shifts_of_gradients() -> None:
    close(of("grad(x**2 * z, x)[t-2]"), 2 * X[T - 2] * Z[T - 2])
    close(of("grad(x**2 * z, x).past(3)"), 2 * X[T - 2 : T + 1] * Z[T - 2 : T + 1])
    close(of("grad(x * x[t-1], x).past(2)"), X[T - 2 : T])


def test_vectors_have_the_shape_of_x() -> None:
    text = """
        dims: {joint: 3}
        inputs: {q: {dims: joint}}
        parameters: {M: {dims: [joint], init: [1, 2, 3]}}
        equations: {energy: "sum(0.5 * M * q * q)"}
        outputs: {y: "grad(energy, q)", w: "grad(sin(q), q)"}
        """
    q = RANDOM.normal(size=(20, 3))
    close(evaluated(text, {"q": q}, 5), np.array([1.0, 2, 3]) * q[5])
    close(evaluated(text, {"q": q}, 5, output="w"), np.cos(q[5]))


def test_with_respect_to_states_also_in_a_vector_field() -> None:
    """A Hamiltonian system: at every stage of the integrator the gradient at that stage."""
    text = """
        inputs: {u: N}
        equations: {energy: "0.5 * p**2 + 1 - cos(q)"}
        states:
          q: {der: "grad(energy, p)", init: 1}
          p: {der: "u - grad(energy, q)"}
        outputs: {y: q, slope: "grad(energy, q)"}
        """
    written = text.replace('"grad(energy, p)"', "p").replace("u - grad(energy, q)", "u - sin(q)")
    log = {"u": RANDOM.normal(size=30)}
    close(simulated(text, log, 0, 30), simulated(written, log, 0, 30))
    q = simulated(text, log, 0, 30)
    close(simulated(text, log, 0, 30, output="slope"), np.sin(q))


def test_the_past_of_the_simulation_is_given() -> None:
    """Buffers and states are not differentiated: within the sample e[t-1] is a number."""
    more = 'equations: {e: {expr: "0.5 * e[t-1] + x * x", history: 0}}'
    close(of("grad(e, x)", more), 2 * X[T])


def test_of_what_a_function_is_given() -> None:
    more = 'functions: {slope: {args: [a, b], expr: "grad(a * b, b)"}}'
    close(of("slope(z, x)", more), Z[T])
    close(of("slope(z, x.past(2))", more), [Z[T], Z[T]])


def test_kinks_and_untaken_branches() -> None:
    close(of("grad(abs(x - x), x) + grad(relu(x - x), x)"), 0)
    close(of("grad(max(x, x), x)"), 1)
    # the branch that is not taken has an infinite slope at 0 and none below
    close(of("grad(where(z - z > 0, sqrt(x - x), x * z), x)"), Z[T])
    close(of("grad(where(x > 100, log(x - 100), x * x), x)"), 2 * X[T])
    close(of("grad(grad(where(x > 100, log(x - 100), x**3), x), x)"), 6 * X[T])
    close(of("grad(where(x > 1e3, 1, 0), x)"), 0)


def test_units() -> None:
    program = compiled("""
        inputs: {q: m}
        parameters: {k: 3 N/m}
        equations: {energy: {expr: 0.5 * k * q * q, unit: N*m}}
        outputs: {force: "grad(energy, q)", k2: "grad(grad(energy, q), q)"}
        """)
    units = [program.step[output.node].type.unit for output in program.outputs]
    assert [unit.text if unit else None for unit in units] == ["N", "N/m"]


def test_a_static_model_has_gradients() -> None:
    text = "msnn: 1\nname: s\ninputs: {x: {unit: 1}}\noutputs: {y: 'grad(x**2, x)'}\n"
    from compiler.elaboration.compile import compile_spec
    from spec_schema.reading.reader import read_spec

    program = compile_spec(read_spec("s.yaml", text).spec).program
    rows = np.arange(4)
    found = Interpreter(program).step({"x": X}, rows, {})
    close(found.outputs["y"], 2 * X[:4])


LAYERS = {
    "mlp": "n: {mlp: {hidden: [5, 4], init: {uniform: {min: -1, max: 1}}}}",
    "sigmoid mlp": "n: {mlp: {hidden: 5, activation: sigmoid}}",
    "learner": "n: {equation_learner: {functions: [sin, mul, exp], init: 0.3}}",
    "table": """
  n: {interpolation: {x: [-4, 0, 1, 4], x2: [-4, 0.3, 4],
      y: [[0, 1, 3], [2, 0, 1], [1, 5, 2], [3, 1, 4]]}}""",
}


@pytest.mark.parametrize("layer", LAYERS)
def test_through_layers_as_central_differences(layer: str) -> None:
    more = f"layers: {{{LAYERS[layer].strip()}}}"
    step = 1e-5
    ahead, behind = X + step, X - step
    text = f'{SIGNALS}{more}\noutputs: {{y: "n(x, z)", d: "grad(n(x, z), x)"}}'
    quotient = (
        evaluated(text, {"x": ahead, "z": Z}, T) - evaluated(text, {"x": behind, "z": Z}, T)
    ) / (2 * step)
    # the quotient's own error is of the order of step²
    np.testing.assert_allclose(
        evaluated(text, {"x": X, "z": Z}, T, output="d"), quotient, rtol=1e-7, atol=1e-8
    )


def test_through_fuzzy_local_models() -> None:
    text = f"""
        {SIGNALS}
        layers:
          phi: {{fuzzify: {{centers: [-3, -1, 0.5, 2]}}}}
          m: {{local_model: {{by: phi(x), cell: {{linear: {{}}}}}}}}
        outputs: {{y: "m(z)", d: "grad(m(z), x)", e: "grad(m(z), z)"}}
        """
    weights = {"m.weight": np.array([1.0, 2, -1, 4]), "m.bias": np.array([0.5, 0, 1, -2])}
    shapes = {p.name: [a.size for a in p.axes] for p in compiled(text).parameters}
    weights = {name: value.reshape(shapes[name]) for name, value in weights.items()}
    log = {"x": X, "z": Z}
    i = int(np.searchsorted([-3, -1, 0.5, 2], X[T])) - 1
    width = [2, 1.5, 1.5][i]
    cell = weights["m.weight"].ravel() * Z[T] + weights["m.bias"].ravel()
    close(evaluated(text, log, T, weights, "d"), (cell[i + 1] - cell[i]) / width)
    share = (X[T] - [-3, -1, 0.5, 2][i]) / width
    w = weights["m.weight"].ravel()
    close(evaluated(text, log, T, weights, "e"), (1 - share) * w[i] + share * w[i + 1])


def test_as_autograd_of_torch() -> None:
    """u, u_x, u_xx, u_xz of a network, by another implementation of differentiation."""
    text = f"""{SIGNALS}
layers: {{n: {{mlp: {{hidden: [6, 5]}}}}}}
equations: {{u: "n(x, z)", u_x: "grad(u, x)"}}
outputs: {{y: u, a: u_x, b: "grad(u_x, x)", c: "grad(u_x, z)"}}
"""
    program = compiled(text)
    weights = {
        p.name: torch.tensor(RANDOM.normal(size=[a.size for a in p.axes]), dtype=torch.float64)
        for p in program.parameters
    }
    x = torch.tensor(X[T], dtype=torch.float64, requires_grad=True)
    z = torch.tensor(Z[T], dtype=torch.float64, requires_grad=True)
    h = torch.stack([x, z])
    for layer in (1, 2, 3):
        h = weights[f"n.weight{layer}"].reshape(-1, len(h)) @ h + weights[f"n.bias{layer}"]
        h = torch.tanh(h) if layer < 3 else h
    u = h.squeeze()
    (u_x,) = torch.autograd.grad(u, x, create_graph=True)
    u_xx, u_xz = torch.autograd.grad(u_x, (x, z))
    arrays = {name: weight.numpy() for name, weight in weights.items()}
    for output, expected in zip("yabc", (u, u_x, u_xx, u_xz), strict=True):
        found = evaluated(text, {"x": X, "z": Z}, T, arrays, output)
        close(found, expected.detach().numpy())


@pytest.mark.parametrize(
    ("expression", "code"),
    [
        ("grad(x, z)", "E0711"),
        ("grad(x[t-1], x)", "E0711"),
        ("grad(x, 2 * x)", "E0712"),
        ("grad(k * x, k)", "E0712"),
        ("grad(x, dt)", "E0712"),
        ("grad(x, 3)", "E0712"),
        ("grad(x)", "E0305"),
    ],
)
def test_mistakes(expression: str, code: str) -> None:
    text = f'{SIGNALS}parameters: {{k: 2}}\noutputs: {{y: "{expression}", used: x + z + k}}'
    assert codes(text) == [code]

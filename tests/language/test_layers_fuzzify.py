"""`fuzzify` and `local_model`: values against plain numpy, and all backends against each other."""

import numpy as np
import pytest

from tests.language.compiled import Array, codes, compiled, evaluated
from tests.language.every_backend import assert_backends_agree

GENERATOR = np.random.default_rng(5)
X = GENERATOR.uniform(-3, 11, size=40)
V = GENERATOR.uniform(0, 4, size=40)
LOG = {"x": X, "v": V}
HEAD = """
dims: {ch: 4, v_ch: 3, joint: 2}
inputs: {x: m, v: m}
functions:
  bell: {args: [d], expr: exp(-abs(d))}
layers:
  phi: {fuzzify: {centers: [-1, 0, 3, 5], dim: ch}}
  psi: {fuzzify: {centers: [0, 1, 3], dim: v_ch}}
  gauss: {fuzzify: {centers: [-1, 0, 3, 5], dim: ch, membership: gaussian}}
  box: {fuzzify: {centers: [0, 1, 2, 3], membership: rectangular}}
  own: {fuzzify: {centers: [-1, 0, 3, 5], membership: {function: bell}, dim: ch}}
  learned: {fuzzify: {centers: [-1, 0, 3, 5], dim: ch, learn: true}}
  grid: {fuzzify: {over: [phi, psi], combine: product}}
  local: {local_model: {by: [phi(x), psi(v)], cell: {fir: {window: 2}}}}
  gridded: {local_model: {by: ["grid(x, v)"], cell: {fir: {window: 2}}}}
  mixed: {local_model: {by: [box(x)], cell: {linear: {out: joint}}}}
"""
CENTERS = np.array([-1.0, 0, 3, 5])


def hats(value: float, knots: Array) -> Array:
    """Degrees of membership by numpy's own linear interpolation of each unit vector."""
    return np.array([np.interp(value, knots, row) for row in np.eye(len(knots))])


def value(expression: str, row: int, **weights: Array) -> Array:
    named = {name.replace("__", "."): array for name, array in weights.items()}
    return evaluated(HEAD + f'outputs: {{y: "{expression}"}}', LOG, row, named)


@pytest.mark.parametrize(
    ("x", "expected"),
    # the peer's reference case 5, measured
    [
        (-2, [1, 0, 0, 0]),
        (-0.5, [0.5, 0.5, 0, 0]),
        (1, [0, 2 / 3, 1 / 3, 0]),
        (1.5, [0, 0.5, 0.5, 0]),
        (2.5, [0, 1 / 6, 5 / 6, 0]),
        (4, [0, 0, 0.5, 0.5]),
        (10, [0, 0, 0, 1]),
    ],
)
@pytest.mark.parametrize("layer", ["phi", "learned"])
def test_triangular_sets(layer: str, x: float, expected: list[float]) -> None:
    found = value(f"{layer}({x})", 0)
    # a quotient times its divisor rounds twice
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-15)


def test_rectangular_sets_are_one_hot() -> None:
    for index, x in enumerate([-0.5, 1.0, 2.4, 9.0]):
        np.testing.assert_array_equal(value(f"box({x})", 0), np.eye(4)[index])


def test_sets_of_a_function_and_gaussian_ones() -> None:
    np.testing.assert_allclose(value("own(x)", 7), np.exp(-np.abs(X[7] - CENTERS)), rtol=1e-15)
    widths = np.array([0.5, 1.0, 1.25, 1.0])
    expected = np.exp(-(((X[7] - CENTERS) / widths) ** 2) / 2)
    np.testing.assert_allclose(value("gauss(x)", 7), expected, rtol=1e-13)


def test_learned_centers_keep_their_order() -> None:
    found = value("learned(x)", 3, learned__first=np.array(-2.0), learned__gaps=np.ones(3))
    np.testing.assert_allclose(found, hats(X[3], np.arange(-2.0, 2)), atol=1e-15)
    gaps = compiled(HEAD + 'outputs: {y: "learned(x)"}').parameter("learned.gaps")
    assert gaps.minimum == 0
    assert gaps.initial == (1, 3, 2)


def test_grid_is_the_product_of_its_sets() -> None:
    expected = np.outer(hats(X[2], CENTERS), hats(V[2], np.array([0.0, 1, 3])))
    np.testing.assert_allclose(value("grid(x, v)", 2), expected, atol=1e-15)


@pytest.mark.parametrize("layer", ["local", "gridded"])
def test_local_model_is_the_weighted_sum_of_its_cells(layer: str) -> None:
    weight = GENERATOR.normal(size=(4, 3, 2))
    found = value(f"{layer}(x)", 9, **{f"{layer}__weight": weight})
    degrees = np.outer(hats(X[9], CENTERS), hats(V[9], np.array([0.0, 1, 3])))
    # twelve terms in another order than numpy's
    np.testing.assert_allclose(found, np.sum(degrees * (weight @ X[8:10])), rtol=1e-13)


def test_cells_over_sets_without_a_dim() -> None:
    weight, bias = GENERATOR.normal(size=(4, 2, 1)), GENERATOR.normal(size=(4, 2))
    found = value("mixed(v)", 4, mixed__weight=weight, mixed__bias=bias)
    index = int(np.clip(np.round(X[4]), 0, 3))
    np.testing.assert_allclose(found, weight[index, :, 0] * V[4] + bias[index], rtol=1e-15)


def test_backends_agree() -> None:
    outputs = """
outputs:
  a: gridded(x)
  b: mixed(x)
  c: sum(gauss(x)) + sum(own(x))
  d: learned(x)
  e: phi(x.past(4))
"""
    assert_backends_agree(HEAD + outputs, LOG, [4, 9, 20])


@pytest.mark.parametrize(
    ("layers", "code"),
    [
        ("{fuzzify: {dim: ch}}", "E0203"),
        ("{fuzzify: {over: [phi], centers: [0, 1]}}", "E0228"),
        ("{fuzzify: {over: [plain, phi]}}", "E0313"),
        ("{fuzzify: {over: [phi, phi]}}", "E0225"),
        ("{fuzzify: {over: [h]}}", "E0313"),
        ("{fuzzify: {centers: [0, 1], membership: round}}", "E0207"),
        ("{fuzzify: {centers: [0, 1], membership: {shape: bell}}}", "E0204"),
        ("{fuzzify: {centers: [0, 1], membership: {function: bel}}}", "E0301"),
        ("{fuzzify: {centers: [0, 1], membership: rectangular, learn: true}}", "E0313"),
        ("{local_model: {by: [phi(x), phi(u)], cell: {fir: {window: 2}}}}", "E0402"),
        ("{local_model: {by: [x], cell: {fir: {window: 2}}}}", "E0402"),
    ],
)
def test_mistake(layers: str, code: str) -> None:
    spec = f"""
dims: {{ch: 2}}
inputs: {{x: m, u: m}}
functions: {{bell: {{args: [d], expr: exp(-d)}}}}
layers:
  phi: {{fuzzify: {{centers: [0, 5], dim: ch}}}}
  plain: {{fuzzify: {{centers: [0, 5]}}}}
  h: {{linear: {{}}}}
  bad: {layers}
outputs:
  y: sum(phi(x)) + sum(plain(x)) + h(x) + bell(1) + sum(bad(CALL))
"""
    arguments = "x, u" if "over: [p" in layers else "x"
    assert code in codes(spec.replace("CALL", arguments))

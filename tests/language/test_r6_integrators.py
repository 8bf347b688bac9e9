"""R6: continuous states are integrated together; inputs and discrete states are held."""

from collections.abc import Callable

import numpy as np
import pytest

from tests.language.compiled import Array, simulated

F = np.sin(np.arange(60.0) / 7)
MASS_SPRING_DAMPER = """
inputs: {F: N}
parameters: {m: 1.5 kg, c: 0.8 N*s/m, k: 6 N/m}
equations:
  spring: k * x
  force: F - spring - c * v
states:
  x: {unit: m, der: v, init: 0.3}
  v: {unit: m/s, der: force / m, init: -0.1}
outputs: {y: "stack(x, v)"}
"""


def field(state: Array, force: float) -> Array:
    x, v = state
    return np.array([v, (force - 6 * x - 0.8 * v) / 1.5])


def euler(state: Array, force: float, h: float) -> Array:
    return state + h * field(state, force)


def midpoint(state: Array, force: float, h: float) -> Array:
    return state + h * field(state + h / 2 * field(state, force), force)


def rk4(state: Array, force: float, h: float) -> Array:
    k1 = field(state, force)
    k2 = field(state + h / 2 * k1, force)
    k3 = field(state + h / 2 * k2, force)
    k4 = field(state + h * k3, force)
    return state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


@pytest.mark.parametrize(
    ("integrator", "method", "substeps"),
    [
        ("", rk4, 1),
        ("integrator: rk4", rk4, 1),
        ("integrator: {rk4: {substeps: 3}}", rk4, 3),
        ("integrator: {euler: {substeps: 1}}", euler, 1),
        ("integrator: {euler: {substeps: 4}}", euler, 4),
        ("integrator: midpoint", midpoint, 1),
        ("integrator: {midpoint: {substeps: 2}}", midpoint, 2),
    ],
)
def test_r6_integrator_matches_a_hand_written_one(
    integrator: str, method: Callable[[Array, float, float], Array], substeps: int
) -> None:
    found = simulated(MASS_SPRING_DAMPER + integrator, {"F": F}, 0, 50)
    state = np.array([0.3, -0.1])
    for step in range(50):
        # 50 steps of the same operations in another order of sums
        np.testing.assert_allclose(found[step], state, rtol=1e-12, atol=1e-14)
        for _ in range(substeps):
            state = method(state, F[step], 0.1 / substeps)


def test_r6_equations_between_states_are_evaluated_at_every_stage() -> None:
    """`drag` depends on the state: holding it over the step would give Euler's result."""
    text = """
        inputs: {u: N}
        equations: {drag: "v * v"}
        states: {v: {der: u - drag, init: 1}}
        outputs: {y: v}
        """
    found = simulated(text, {"u": np.zeros(30)}, 0, 20)
    exact = 1 / (1 + 0.1 * np.arange(20))  # v' = -v²
    np.testing.assert_allclose(found, exact, rtol=1e-5)


def test_r6_a_discrete_state_is_held_over_the_step() -> None:
    text = """
        inputs: {u: N}
        states:
          z: {next: u, init: 1}
          v: {der: z}
        outputs: {y: v}
        """
    u = np.arange(10.0)
    held = np.concatenate([[1.0], u[:9]])
    expected = np.concatenate([[0.0], np.cumsum(0.1 * held)[:-1]])
    np.testing.assert_allclose(simulated(text, {"u": u}, 0, 10), expected, rtol=1e-14)


def test_r6_next_may_correct_the_flow() -> None:
    text = """
        inputs: {u: N}
        states: {v: {der: u, next: "min(flow(v), 0.25)"}}
        outputs: {y: next(v), rate: der(v)}
        """
    u = np.ones(10)
    np.testing.assert_allclose(
        simulated(text, {"u": u}, 0, 5), [0.1, 0.2, 0.25, 0.25, 0.25], rtol=1e-15
    )
    np.testing.assert_array_equal(simulated(text, {"u": u}, 0, 5, output="rate"), u[:5])


def test_r6_vector_states() -> None:
    text = """
        dims: {joint: 3}
        inputs: {u: {dims: joint}}
        parameters: {a: {init: [1, 2, 3], dims: joint}}
        states: {q: {dims: joint, der: u - a * q, init: 1}}
        integrator: euler
        outputs: {y: q}
        """
    u = np.random.default_rng(0).normal(size=(10, 3))
    q = np.ones(3)
    found = simulated(text, {"u": u}, 0, 8)
    for step in range(8):
        np.testing.assert_allclose(found[step], q, rtol=1e-13)
        q = q + 0.1 * (u[step] - np.array([1.0, 2, 3]) * q)

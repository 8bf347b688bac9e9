"""R6: continuous states are integrated together; inputs and discrete states are held."""

from collections.abc import Callable

import numpy as np
import pytest

from tests.language.compiled import Array, compiled, simulated, warnings_of

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
def test_integrator_matches_a_hand_written_one(
    integrator: str, method: Callable[[Array, float, float], Array], substeps: int
) -> None:
    found = simulated(MASS_SPRING_DAMPER + integrator, {"F": F}, 0, 50)
    state = np.array([0.3, -0.1])
    for step in range(50):
        # 50 steps of the same operations in another order of sums
        np.testing.assert_allclose(found[step], state, rtol=1e-12, atol=1e-14)
        for _ in range(substeps):
            state = method(state, F[step], 0.1 / substeps)


def test_equations_between_states_are_evaluated_at_every_stage() -> None:
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


def test_a_discrete_state_is_held_over_the_step() -> None:
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


def test_next_may_correct_the_flow() -> None:
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


def test_vector_states() -> None:
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


OSCILLATOR = """
inputs: {u: N}
states:
  v: {der: "-x + 0 * u", init: 0}
  x: {der: v, init: 1}
outputs: {y: x, e: "0.5 * x**2 + 0.5 * v**2"}
"""


def semi_implicit(v: float, x: float, h: float) -> tuple[float, float]:
    v = v - h * x
    return v, x + h * v


def test_semi_implicit_moves_states_as_listed() -> None:
    """Velocity first, then the position with the new velocity; listed otherwise, otherwise."""
    log = {"u": np.zeros(60)}
    found = simulated(OSCILLATOR + "integrator: {semi_implicit: {substeps: 2}}", log, 0, 50)
    v, x = 0.0, 1.0
    for step in range(50):
        assert found[step] == pytest.approx(x, rel=1e-12, abs=1e-14)
        for _ in range(2):
            v, x = semi_implicit(v, x, 0.05)
    swapped = OSCILLATOR.replace('v: {der: "-x + 0 * u", init: 0}', "").replace(
        "x: {der: v, init: 1}", 'x: {der: v, init: 1}\n  v: {der: "-x + 0 * u", init: 0}'
    )
    found = simulated(swapped + "integrator: semi_implicit", log, 0, 50)
    v, x = 0.0, 1.0
    for step in range(50):
        assert found[step] == pytest.approx(x, rel=1e-12, abs=1e-14)
        x = x + 0.1 * v
        v = v - 0.1 * x


def test_semi_implicit_keeps_the_energy_of_an_oscillator() -> None:
    """Symplectic: the energy oscillates by O(h) and does not drift; explicit Euler doubles it."""
    log = {"u": np.zeros(2001)}
    energy = simulated(OSCILLATOR + "integrator: semi_implicit", log, 0, 2000, output="e")
    assert np.all(np.abs(energy - 0.5) < 0.05)
    assert simulated(OSCILLATOR + "integrator: euler", log, 0, 200, output="e")[-1] > 1


@pytest.mark.parametrize(
    ("method", "order"),
    [("euler", 1), ("semi_implicit", 1), ("linear_implicit", 1), ("midpoint", 2), ("rk4", 4)],
)
def test_order_of_convergence(method: str, order: int) -> None:
    """Halving the step divides the error at a fixed time by 2 to the order."""
    text = """
        inputs: {u: N}
        states:
          x: {der: "v + 0 * u", init: 1}
          v: {der: "-sin(x) - 0.3 * v**3", init: 0.5}
        outputs: {y: x}
        """
    log = {"u": np.zeros(12)}

    def at_one_second(method: str, substeps: int) -> float:
        spec = text + f"integrator: {{{method}: {{substeps: {substeps}}}}}"
        return float(simulated(spec, log, 0, 11)[-1])

    exact = at_one_second("rk4", 16)
    coarse, fine = (abs(at_one_second(method, n) - exact) for n in (1, 2))
    # the next term of the error is what is left of the step at this step size
    assert np.log2(coarse / fine) == pytest.approx(order, abs=0.25)


def linearly_implicit(x: Array, u: Array, K: Array, h: float) -> Array:
    """A step of Euler's backward method, with the Jacobian at its beginning."""
    q, w, s = x[:2], x[2:4], x[4]
    f = np.concatenate([w, u - K * q - 0.2 * w * s, [q.sum() - 3 * s]])
    J = np.zeros((5, 5))
    J[:2, 2:4] = np.eye(2)
    J[2:4, :2] = -np.diag(K)
    J[2:4, 2:4] = -0.2 * s * np.eye(2)
    J[2:4, 4] = -0.2 * w
    J[4] = [1, 1, 0, 0, -3]
    return x + np.linalg.solve(np.eye(5) - h * J, h * f)


def test_linear_implicit_is_linear_algebra() -> None:
    """For x' = A x + b the method is (I - h A) Δ = h (A x + b), vectors as well as scalars."""
    text = """
        dims: {joint: 2}
        inputs: {u: {dims: joint}}
        parameters: {K: {dims: [joint], init: [30, 4]}}
        states:
          q: {dims: joint, der: w, init: 1}
          w: {dims: joint, der: "u - K * q - 0.2 * w * s"}
          s: {der: "sum(q) - 3 * s", init: 0.5}
        integrator: {linear_implicit: {substeps: 2}}
        outputs: {y: q, z: s}
        """
    u = np.random.default_rng(3).normal(size=(20, 2))
    K = np.array([30.0, 4.0])
    x, h = np.array([1.0, 1, 0, 0, 0.5]), 0.05
    found, last = simulated(text, {"u": u}, 0, 15), simulated(text, {"u": u}, 0, 15, output="z")
    for step in range(15):
        np.testing.assert_allclose(np.append(found[step], last[step]), x[[0, 1, 4]], rtol=1e-10)
        for _ in range(2):
            x = linearly_implicit(x, u[step], K, h)


def test_linear_implicit_computes_no_zeros_of_the_jacobian() -> None:
    """Of joints that do not feel each other each brings as many operations as the others."""

    def operations(joints: int) -> int:
        program = compiled(f"""
            dims: {{joint: {joints}}}
            inputs: {{u: {{dims: joint}}}}
            states:
              q: {{dims: joint, der: w}}
              w: {{dims: joint, der: "u - where(q > 0, sin(q) / q, 1) - exp(-w) * w"}}
            integrator: linear_implicit
            outputs: {{y: q}}
            """)
        return len(program.step)

    assert operations(8) - operations(6) == operations(4) - operations(2) > 0


def test_linear_implicit_stays_stable_on_a_stiff_system() -> None:
    """Van der Pol with μ = 100: the explicit methods leave every bound within a few steps."""
    text = """
        inputs: {u: N}
        states:
          x: {der: "v + 0 * u", init: 2}
          v: {der: "100 * (1 - x**2) * v - x"}
        outputs: {y: x}
        """
    log = {"u": np.zeros(900)}
    found = simulated(text + "integrator: linear_implicit", log, 0, 600)
    assert np.all(np.abs(found) < 2.2)
    with np.errstate(all="ignore"):
        assert not np.isfinite(simulated(text + "integrator: rk4", log, 0, 600)[-1])


INTEGRATORS = ("euler", "semi_implicit", "linear_implicit", "midpoint", "rk4")


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_state_without_a_unit_is_told_of_none(integrator: str) -> None:
    for law in ("tanh(u) - x", "exp(-x) - x", "3 - x", "x * dt - x"):
        text = (
            f"inputs: {{u: {{}}}}\nstates: {{x: {{der: {law}}}}}\noutputs: {{y: tanh(x) + x + u}}\n"
            f"integrator: {{{integrator}: {{substeps: 3}}}}"
        )
        assert warnings_of(text) == []


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_state_with_a_unit_is_checked(integrator: str) -> None:
    text = (
        "inputs: {u: m}\nstates: {x: {unit: m, der: u - x}}\noutputs: {y: x}\n"
        f"integrator: {integrator}"
    )
    assert "W0504" in warnings_of(text)

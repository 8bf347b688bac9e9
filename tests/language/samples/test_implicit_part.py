"""`linear_implicit: {of: NAME}`: only what a state feels of one equation is implicit (R6)."""

from pathlib import Path

import numpy as np

from compiler.interpreter.interpreter import Interpreter
from compiler.ir import ops
from compiler.ir.nodes import needed
from tests.features.robots.robots import URDF, model_of
from tests.language.compiled import compiled, simulated

H = 0.05


def test_a_mass_with_friction_is_solved_by_one_division() -> None:
    text = """
    inputs: {F: N}
    parameters: {m: 1.5 kg, c: 0.8 N*s/m, k: 6 N/m}
    equations: {drag: c * v + 0.1 * v**3}
    states:
      x: {unit: m, der: v, init: 0.3}
      v: {unit: m/s, der: (F - k * x - drag) / m, init: -2}
    integrator: {linear_implicit: {of: drag, substeps: 2}}
    outputs: {y: "stack(x, v)"}
    """
    F = np.sin(np.arange(30.0) / 5)
    x, v = 0.3, -2.0
    expected = []
    for force in F:
        expected.append([x, v])
        for _ in range(2):
            slope = (force - 6 * x - 0.8 * v - 0.1 * v**3) / 1.5
            v += H * slope / (1 + H * (0.8 + 0.3 * v**2) / 1.5)
            x += H * v
    # the operations of 30 steps, each rounded
    np.testing.assert_allclose(simulated(text, {"F": F}, 0, 30), expected, rtol=1e-12)


def test_inputs_between_samples_count_at_the_end_of_each_step() -> None:
    """As in the implicit Euler method, for the state that is felt and for those beside it."""
    text = """
    inputs: {F: {between: linear}, w: {between: linear}}
    equations: {drag: 0.8 * v + 0.1 * v**3}
    states:
      x: {der: v + w, init: 0.3}
      v: {der: F - 6 * x - drag, init: -2}
    integrator: {linear_implicit: {of: drag, substeps: 2}}
    outputs: {y: "stack(x, v)"}
    """
    log = {"F": np.sin(np.arange(21.0) / 2), "w": np.cos(np.arange(21.0) / 3)}
    x, v = 0.3, -2.0
    expected = []
    for t in range(20):
        expected.append([x, v])
        for over in (0.5, 1.0):
            F, w = ((1 - over) * log[name][t] + over * log[name][t + 1] for name in ("F", "w"))
            v += H * (F - 6 * x - 0.8 * v - 0.1 * v**3) / (1 + H * (0.8 + 0.3 * v**2))
            x += H * (v + w)
    np.testing.assert_allclose(simulated(text, log, 0, 20), expected, rtol=1e-12)


def test_what_couples_states_is_solved_as_a_system() -> None:
    text = """
    dims: {wheel: 2}
    inputs: {F: {dims: wheel}}
    equations:
      drag: 3 * tanh(v / 0.1)
      left: part(drag, 0)
      right: part(drag, 1)
      felt: stack(2 * left - 0.5 * right, right - 0.5 * left, dim=wheel)
    states: {v: {dims: wheel, der: F - felt, init: 1}}
    integrator: {linear_implicit: {of: drag}}
    outputs: {y: v}
    """
    F = np.random.default_rng(1).normal(size=(20, 2))
    A = np.array([[2.0, -0.5], [-0.5, 1.0]])
    v = np.ones(2)
    expected = []
    for force in F:
        expected.append(v)
        drag = 3 * np.tanh(v / 0.1)
        own = 3 / 0.1 / np.cosh(v / 0.1) ** 2
        v = v + np.linalg.solve(np.eye(2) + 0.1 * A * own, 0.1 * (force - A @ drag))
    np.testing.assert_allclose(simulated(text, {"F": F}, 0, 20), expected, rtol=1e-9)


ARM = f"""
dims: {{joint: [shoulder, elbow]}}
use: {{arm: {{robot: {{urdf: {URDF}/planar.urdf, joints: joint, armature: 0.02}}}}}}
inputs: {{tau: {{unit: N*m, dims: joint}}}}
parameters: {{c: {{init: 0.7, unit: N*m*s/rad, dims: joint}}}}
equations:
  tau_f: c * dq + 2 * tanh(dq / 0.1)
  ddq: arm.forward_dynamics(q, dq, tau - tau_f)
states:
  q: {{unit: rad, dims: joint, der: dq, init: q.meas}}
  dq: {{unit: rad/s, dims: joint, der: ddq, init: dq.meas}}
integrator: INTEGRATOR
outputs:
  q_next: next(q)
  dq_next: next(dq)
  M: arm.mass_matrix(q)
  bias: arm.inverse_dynamics(q, dq, 0)
"""


def test_the_friction_of_a_robot_joins_its_mass_matrix(tmp_path: Path) -> None:
    text = ARM.replace("INTEGRATOR", "{linear_implicit: {of: tau_f, substeps: 2}}")
    half = ARM.replace("INTEGRATOR", "{linear_implicit: {of: tau_f}}")
    rng = np.random.default_rng(2)
    log = {name: rng.normal(size=(1, 2)) for name in ("tau", "q", "dq")}

    def step(text: str, q: np.ndarray, dq: np.ndarray) -> dict[str, np.ndarray]:
        interpreter = Interpreter(model_of(tmp_path, text).program)
        series = {"tau": log["tau"], "q": q[None], "dq": dq[None]}
        rows = np.array([0])
        found = interpreter.step(series, rows, interpreter.start(series, rows)).outputs
        return {name: value[0] for name, value in found.items()}

    q, dq, h = log["q"][0], log["dq"][0], 0.005
    found = step(text, q, dq)
    for _ in range(2):
        at = step(half, q, dq)
        c = 0.7 + 2 / 0.1 / np.cosh(dq / 0.1) ** 2
        right = log["tau"][0] - 0.7 * dq - 2 * np.tanh(dq / 0.1) - at["bias"]
        dq = dq + np.linalg.solve(at["M"] + h * np.diag(c), h * right)
        q = q + h * dq
    np.testing.assert_allclose(found["dq_next"], dq, rtol=1e-11)
    np.testing.assert_allclose(found["q_next"], q, rtol=1e-11)


def test_it_costs_little_more_than_an_explicit_step(tmp_path: Path) -> None:
    def operations(integrator: str) -> int:
        program = model_of(tmp_path, ARM.replace("INTEGRATOR", integrator)).program
        graph = program.step
        used = needed(graph, [program.output(name).node for name in ("q_next", "dq_next")])
        return sum(used[i] and isinstance(n.op, ops.Elementwise) for i, n in graph)

    explicit = operations("semi_implicit")
    assert operations("{linear_implicit: {of: tau_f}}") < 1.3 * explicit
    assert operations("linear_implicit") > 2 * explicit


def test_softplus_relu_and_elu_have_the_unit_of_their_argument() -> None:
    program = compiled(
        """
        inputs: {x: m}
        parameters: {C: 1, K: {init: 1, unit: N/m}}
        equations: {k: {expr: softplus(C), unit: N/m}}
        outputs: {s: softplus(x), r: relu(x), e: elu(x), f: k * x, n: softplus(K)}
        """
    )
    units = {output.name: program.step[output.node].type.unit for output in program.outputs}
    named = {name: unit.text if unit else None for name, unit in units.items()}
    assert named == {"s": "m", "r": "m", "e": "m", "f": "N", "n": "N/m"}

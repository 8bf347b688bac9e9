"""R6: an input with `between: linear` is a straight line between samples in right-hand sides."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import msnn
from compiler.ir.text import program_text
from compiler.passes.simplify import prune_outputs
from compiler.passes.to_step_form import to_step_form
from msnn.agreement.judgement import FloatType
from msnn.data.rollout_rows import reach
from msnn.model.load import load_model
from msnn.model.weights.weights_file import initial_weights
from tests.agreement.exported import checked, plan_of
from tests.conditions import require_tool
from tests.language.compiled import Array, codes, compiled, evaluated, simulated, warnings_of
from tests.language.submodels.submodels import diagnostics, model_of, run
from tests.language.targets.every_backend import assert_backends_agree

F = np.sin(np.arange(40.0) / 3)
LOAD = np.cos(np.arange(40.0) / 5)
OSCILLATOR = """
inputs: {F: {unit: N, between: linear}, load: N}
constants: {one: 1 N}
parameters: {m: 1.5 kg, c: 0.8 N*s/m, k: 6 N/m}
functions: {half: {args: [a], expr: 0.5 * a}}
equations:
  push: half(F) * F / one
  force: push - k * x - c * v - load
states:
  x: {unit: m, der: v, init: 0.3}
  v: {unit: m/s, der: force / m, init: -0.1}
outputs: {y: "stack(x, v)"}
"""

INTEGRATORS = {
    "": 1,
    "integrator: {euler: {substeps: 3}}": 3,
    "integrator: {semi_implicit: {substeps: 2}}": 2,
    "integrator: linear_implicit": 1,
    "integrator: {linear_implicit: {substeps: 3}}": 3,
    "integrator: midpoint": 1,
    "integrator: {midpoint: {substeps: 2}}": 2,
    "integrator: {rk4: {substeps: 3}}": 3,
}
"""As written in a spec, with substeps."""


def line(series: Array, t: int, fraction: float) -> float:
    """The input between rows t and t+1."""
    return float((1 - fraction) * series[t] + fraction * series[t + 1])


def field(state: Array, F: float, load: float) -> Array:
    x, v = state
    return np.array([v, (0.5 * F * F - 6 * x - 0.8 * v - load) / 1.5])


def substep(method: str, x: Array, f: Callable[[Array, float], Array], h: float) -> Array:
    """One step of a method from τ = 0 to 1 of the substep; f takes the part that is over."""
    match method:
        case "euler":
            return x + h * f(x, 0.0)
        case "semi_implicit":  # the position first, then the velocity with the new position
            moved = np.array([x[0] + h * f(x, 0.0)[0], x[1]])
            return np.array([moved[0], x[1] + h * f(moved, 0.0)[1]])
        case "linear_implicit":
            slope = np.array([[0.0, 1.0], [-6 / 1.5, -0.8 / 1.5]])
            return x + np.linalg.solve(np.eye(2) - h * slope, h * f(x, 1.0))
        case "midpoint":
            return x + h * f(x + h / 2 * f(x, 0.0), 0.5)
        case _:
            k1 = f(x, 0.0)
            k2 = f(x + h / 2 * k1, 0.5)
            k3 = f(x + h / 2 * k2, 0.5)
            k4 = f(x + h * k3, 1.0)
            return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_stages_read_the_line_at_their_fraction_of_the_step(integrator: str) -> None:
    substeps = INTEGRATORS[integrator]
    names = ("euler", "semi_implicit", "linear_implicit", "midpoint")
    method = next((name for name in names if name in integrator), "rk4")
    found = simulated(OSCILLATOR + integrator, {"F": F, "load": LOAD}, 0, 39)
    x = np.array([0.3, -0.1])
    for t in range(39):
        # 39 steps of the same operations in another order of sums
        np.testing.assert_allclose(found[t], x, rtol=1e-12, atol=1e-14)
        for number in range(substeps):

            def f(at: Array, part: float, t: int = t, number: int = number) -> Array:
                return field(at, line(F, t, (number + part) / substeps), LOAD[t])

            x = substep(method, x, f, 0.1 / substeps)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_every_backend_reads_the_line(integrator: str) -> None:
    assert_backends_agree(OSCILLATOR + integrator, {"F": F, "load": LOAD}, [0, 7, 20, 38])


TYPES: list[tuple[str, FloatType]] = [
    ("torch", "float64"),
    ("onnx", "float64"),
    ("casadi", "float64"),
    ("c", "float64"),
    ("c", "float32"),
]


@pytest.mark.parametrize(("target", "dtype"), TYPES)
def test_exports_run_with_a_preview_port(target: str, dtype: FloatType, tmp_path: Path) -> None:
    if target == "c":
        require_tool("gcc", "apt install gcc")
    program = compiled(OSCILLATOR)
    step = to_step_form(prune_outputs(program, ["y"]))
    assert checked(plan_of(target, step, dtype), initial_weights(program), tmp_path).agrees


@given(
    start=st.floats(-10, 10),
    slope=st.floats(-10, 10),
    method=st.sampled_from(["rk4", "midpoint", "{rk4: {substeps: 3}}"]),
)
def test_a_line_is_integrated_exactly(start: float, slope: float, method: str) -> None:
    """u(t) = a + b t: x grows by h (u[t] + u[t+1]) / 2, as every rule of order 2 gives it."""
    text = f"""
        inputs: {{u: {{between: linear}}}}
        states: {{x: {{der: u}}}}
        integrator: {method}
        outputs: {{y: x}}
        """
    t = 0.1 * np.arange(12)
    found = simulated(text, {"u": start + slope * t}, 0, 11)
    # sums of at most 11 · 3 numbers up to 22, each rounded a few times
    np.testing.assert_allclose(found, start * t[:11] + slope * t[:11] ** 2 / 2, atol=1e-13)


def test_two_states_of_a_double_integrator_follow_a_line_exactly() -> None:
    """rk4 is exact for x'' = a + b t: its third derivative is constant."""
    text = """
        inputs: {u: {between: linear}}
        states: {x: {der: v}, v: {der: u}}
        outputs: {y: x}
        """
    t = 0.1 * np.arange(20)
    found = simulated(text, {"u": 2 - 3 * t}, 0, 19)
    np.testing.assert_allclose(found, t[:19] ** 2 - t[:19] ** 3 / 2, atol=1e-13)


MEMORY = """
inputs: {{u: {{between: {between}}}}}
layers: {{h: {{fir: {{window: 3}}}}, g: {{iir: {{num: 1, den: 1}}}}}}
equations: {{late: "u[t-1]", slow: g(u)}}
states:
  x: {{der: "sum(u.past(2)) + u[t-2] + h(u) + late + slow + integral(u) + der(u) - x"}}
  z: {{next: u}}
outputs: {{y: "x + u + z"}}
"""


def test_windows_delays_memory_and_outputs_see_samples() -> None:
    linear, held = (MEMORY.format(between=word) for word in ("linear", "hold"))
    assert program_text(compiled(linear)) == program_text(compiled(held))
    assert warnings_of(linear) == ["W0745"]


def test_outputs_beside_a_line_see_the_sample() -> None:
    text = """
        inputs: {u: {between: linear}}
        states: {x: {der: u, init: 1}, z: {next: u, init: 0}}
        outputs: {y: "stack(u, z, der(x), next(x))"}
        """
    found = evaluated(text, {"u": [3.0, 7.0]})
    np.testing.assert_allclose(found, [3, 0, 3, 1.5], rtol=1e-15)


def test_u_at_t_is_u() -> None:
    text = "inputs: {{u: {{between: linear}}}}\nstates: {{x: {{der: '{0}'}}}}\noutputs: {{y: x}}"
    assert program_text(compiled(text.format("u[t]"))) == program_text(compiled(text.format("u")))


def test_the_last_row_of_a_record_has_no_next_sample() -> None:
    """R2: one sample of look-ahead, so that T rows have T - 1 steps."""
    assert reach(compiled(OSCILLATOR)).ahead == 1
    assert reach(compiled(OSCILLATOR.replace("linear", "hold"))).ahead == 0
    euler = OSCILLATOR + "integrator: euler"
    assert reach(compiled(euler)).ahead == 0
    assert "W0745" in warnings_of(euler)


def test_vector_inputs_move_element_by_element() -> None:
    text = """
        dims: {joint: 2}
        inputs: {u: {dims: joint, unit: N, between: linear}}
        states: {x: {dims: joint, der: u, unit: N*s}}
        outputs: {y: x}
        """
    u = np.random.default_rng(0).normal(size=(10, 2))
    expected = np.concatenate([[[0, 0]], np.cumsum(0.05 * (u[:8] + u[1:9]), axis=0)])
    np.testing.assert_allclose(simulated(text, {"u": u}, 0, 9), expected, atol=1e-15)
    assert warnings_of(text) == []  # units of a line are those of its input


def test_a_gradient_in_a_right_hand_side_is_that_at_the_stage() -> None:
    """grad(u³, u) = 3 u² on the line, integrated by rk4 (Simpson's rule, exact for it)."""
    text = """
        inputs: {u: {between: linear}}
        states: {x: {der: "grad(u * u * u, u)"}}
        outputs: {y: next(x)}
        """
    found = evaluated(text, {"u": [1.0, 3.0]})
    np.testing.assert_allclose(found, 0.1 * (27 - 1) / 2, rtol=1e-14)


@pytest.mark.parametrize("u", ["u", "u[t]"])
def test_a_gradient_at_a_stage_takes_samples_in_windows_as_given(u: str) -> None:
    """y = u · (u[t-1] + u[t]): the slope in u is the sum, at every stage alike."""
    text = f"""
        inputs: {{u: {{between: linear}}}}
        states: {{x: {{der: "grad(u * sum(u.past(2)), {u})"}}}}
        outputs: {{y: next(x)}}
        """
    found = evaluated(text, {"u": [2.0, 1.0, 5.0]}, t=1)
    np.testing.assert_allclose(found, 0.1 * 3, rtol=1e-14)


TANK = """
inputs: {inflow: {between: linear}}
states: {level: {der: inflow - 0.5 * level, init: 1}}
outputs: {h: level}
"""


def test_an_input_of_a_sub_model_keeps_its_line_where_nothing_feeds_it(tmp_path: Path) -> None:
    text = "inputs: {u: {}}\nuse: {tank: tank.yaml}\noutputs: {y: tank.h + 0 * u}"
    model = model_of(tmp_path, text, tank=TANK)
    alone = simulated(TANK, {"inflow": F}, 0, 30, output="h")
    found = run(model.program, {"u": F, "tank.inflow": F}, steps=30)
    np.testing.assert_array_equal(found, alone)
    assert model.warnings == ()


def test_what_is_connected_is_held_and_said_to_be(tmp_path: Path) -> None:
    text = """
        inputs: {u: {between: linear}}
        use: {tank: tank.yaml}
        connect: {tank.inflow: 2 * u}
        outputs: {y: tank.h}
        """
    found = diagnostics(tmp_path, text, tank=TANK)
    assert [d.code for d in found] == ["W0745", "W0747"]
    linear = program_text(model_of(tmp_path, text, tank=TANK).program)
    held = model_of(tmp_path, text.replace("linear", "hold"), tank=TANK.replace("linear", "hold"))
    assert program_text(held.program) == linear


def test_a_line_reaches_what_feeds_a_sub_model_without_states(tmp_path: Path) -> None:
    """R6: the sub-models between states and `der` are evaluated at the stages too."""
    gain = "inputs: {a: {}}\noutputs: {b: 2 * a}"
    text = """
        inputs: {u: {between: linear}}
        use: {gain: gain.yaml}
        connect: {gain.a: u}
        states: {x: {der: gain.b}}
        outputs: {y: next(x)}
        """
    program = model_of(tmp_path, text, gain=gain).program
    found = run(program, {"u": np.array([1.0, 4.0])}, steps=1)
    np.testing.assert_allclose(found, [0.5], rtol=1e-15)


def test_an_input_that_is_fed_back_has_no_line() -> None:
    text = """
        inputs: {u: {}, x: {between: linear}}
        states: {v: {der: u - x}}
        outputs: {y: {expr: x + next(v), predicts: "x[t+1]"}}
        """
    assert codes(text) == ["E0226"]
    assert codes(text.replace("linear", "hold")) == []


def test_targets_have_no_between() -> None:
    text = "inputs: {u: {}}\ntargets: {z: {between: linear}}\noutputs: {y: u}"
    assert codes(text) == ["E0201"]


LEARNED = """
inputs: {{force: {{{between}}}, speed: {{}}}}
targets: {{z: {{}}}}
parameters: {{c: 1}}
states: {{v: {{der: {der}, init: 0}}}}
integrator: {integrator}
outputs: {{y: {{expr: v, predicts: "{predicts}"}}}}
train: [{{rollout: record}}]
"""


def remarked(between: str = "", der: str = "force - c * v", integrator: str = "rk4") -> list[str]:
    predicts = "z[t]" if "speed" not in der else "speed[t]"
    text = LEARNED.format(between=between, der=der, integrator=integrator, predicts=predicts)
    return [code for code in warnings_of(text) if code != "W0301"]


def test_the_remark_comes_where_a_parameter_is_learned_beside_a_held_open_input() -> None:
    assert remarked() == ["W0748"]
    assert remarked("between: hold") == []
    assert remarked("between: linear") == []
    assert remarked(der="force - v") == []  # nothing is learned there
    assert remarked(der="speed - c * v") == []  # fed back: its line is not known
    assert remarked(der="'force[t-1] - c * v'") == []  # a sample either way
    assert remarked(integrator="euler") == []  # a line would change nothing
    assert remarked(integrator="{euler: {substeps: 2}}") == ["W0748"]
    untrained = LEARNED.partition("train")[0].format(
        between="", der="force - c * v", integrator="rk4", predicts="z[t]"
    )
    assert "W0748" not in warnings_of(untrained)


def test_simulation_and_slopes_have_the_sample_at_the_end_of_the_step(tmp_path: Path) -> None:
    text = """
        inputs: {u: {between: linear}}
        states: {x: {der: u - x}}
        integrator: midpoint
        outputs: {y: next(x)}
        """
    model = model_of(tmp_path, text)
    (found,), (kernel,) = (
        msnn.simulate(model, {"u": F[:10]}, engine=engine) for engine in ("interpreter", "native")
    )
    assert len(found.outputs["y"]) == 9
    # a stable state: the promise of free runs
    np.testing.assert_allclose(kernel.outputs["y"], found.outputs["y"], atol=1e-12)
    stepped = msnn.stepper(load_model(tmp_path / "main.yaml", ["export={c: {dtype: float64}}"]))
    for t in range(9):
        y = stepped.step(u=F[t : t + 2])["y"]
        np.testing.assert_allclose(y, found.outputs["y"][t], atol=1e-12)
    slopes = msnn.linearize(model, {"u": [1.0, 3.0]}, {"x": 0.5}).matrices
    # x + h (u[t]/2 + u[t+1]/2 - x - h/2 (u[t] - x)) with h = 0.1
    np.testing.assert_allclose(slopes["A"], [[1 - 0.1 + 0.005]], rtol=1e-14)
    np.testing.assert_allclose(slopes["B"], [[0.05 - 0.005, 0.05]], rtol=1e-14)


def test_training_finds_the_parameters_of_a_line(tmp_path: Path) -> None:
    """Of data that follow the exact solution on a line; of a held input there is no such k."""
    text = """
        inputs: {{u: {{between: {0}}}}}
        targets: {{z: {{}}}}
        parameters: {{k: 2}}
        states: {{x: {{der: k * u - 1.5 * x, init: z}}}}
        integrator: {{rk4: {{substeps: 2}}}}
        outputs: {{y: {{expr: x, predicts: "z[t]"}}}}
        train: [{{rollout: record, epochs: 20, optimizer: levenberg_marquardt}}]
        data: {{source: {{train: a.csv}}}}
        """
    u = np.sin(np.arange(60.0))
    z = [0.0]
    decay = np.exp(-0.15)
    for a, b in pairwise(u):
        slope = (b - a) / 0.1
        # the solution of x' = 3 (a + slope t) - 1.5 x after 0.1 s
        at_rest = 3 * (a / 1.5 - slope / 1.5**2)
        z.append(decay * (z[-1] - at_rest) + at_rest + 3 * (b - a) / 1.5)
    learned: dict[str, float] = {}
    for word in ("hold", "linear"):
        model = model_of(tmp_path, text.format(word))
        found = msnn.train(model, {"u": u, "z": np.array(z)}, runs=None)
        learned[word] = float(found.weights["k"])
    # rk4 with h = 0.05 s leaves (1.5 h)^5 / 120 = 2e-8 of a step
    assert abs(learned["linear"] - 3) < 1e-6
    assert abs(learned["hold"] - 3) > 1e-2

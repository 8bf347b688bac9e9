"""R11: `connect` is substitution, in the same step and in the whole past of the input."""

from pathlib import Path

import numpy as np
import pytest

from compiler.ir.program import Program
from compiler.passes.close_loop import close_loop
from tests.language.submodels.submodels import diagnostics, model_of, names, run
from tests.language.targets.every_backend import assert_backends_agree_on

U = np.array([1.0, 2.0, 4.0, 8.0, 16.0, 32.0])
MEMORY = """
    inputs: {u: 1}
    outputs: {y: "u[t-2] + 10 * u[t-1] + 100 * u"}
    """


def test_a_connection_holds_in_the_past_too(tmp_path: Path) -> None:
    text = """
        use: {part: part.yaml}
        inputs: {x: 1}
        connect: {part.u: 3 * x}
        outputs: {y: part.y}
        """
    program = model_of(tmp_path, text, part=MEMORY).program
    np.testing.assert_array_equal(run(program, {"x": U}, t0=2), [3 * 1 + 30 * 2 + 300 * 4])
    assert names(program)["states"] == []  # nothing to keep: x is read earlier


def test_the_past_of_a_prediction_is_what_was_measured(tmp_path: Path) -> None:
    """R5 (b): before the start the input has the log of what the output predicts. R11."""
    text = """
        use: {part: part.yaml}
        inputs: {x: 1, u: 1}
        connect: {part.u: steer}
        outputs: {steer: {expr: 2 * x, predicts: "u[t]"}, y: part.y}
        """
    program = model_of(tmp_path, text, part=MEMORY).program
    logged = 7 * U
    found = run(program, {"x": U, "u": logged}, t0=2, steps=3)
    steer = np.array([7.0, 14.0, 8.0, 16.0, 32.0])  # two logged, three computed
    np.testing.assert_array_equal(found, steer[:-2] + 10 * steer[1:-1] + 100 * steer[2:])
    closed = close_loop(program, ["u"])
    np.testing.assert_array_equal(run(closed, {"x": U, "u": logged}, t0=2, steps=3), found)


def test_history_of_a_connection(tmp_path: Path) -> None:
    text = """
        use: {part: part.yaml}
        inputs: {x: 1}
        connect: {part.u: {expr: x, history: 5}}
        outputs: {y: part.y}
        """
    program = model_of(tmp_path, text, part=MEMORY).program
    found = run(program, {"x": U}, t0=2, steps=2)
    np.testing.assert_array_equal(found, [5 + 50 + 400, 5 + 40 + 800])


def test_a_loop_through_states_of_both(tmp_path: Path) -> None:
    """PI control of a learned plant: x[t+1] = 0.5·x + u, u = 2·(r - x) + i, i[t+1] = i + r - x."""
    program = _controlled(tmp_path)
    reference = np.ones(6)
    x, i = 0.25, 0.0
    expected: list[float] = []
    for _ in range(4):
        u = 2 * (1 - x) + i
        expected.append(u)
        i, x = i + 1 - x, 0.5 * x + u
    logs = {"r": reference, "x": np.full(6, 0.25)}
    np.testing.assert_array_equal(run(program, logs, steps=4, output="u"), expected)


def test_all_backends_agree_on_a_model_with_parts(tmp_path: Path) -> None:
    program = _controlled(tmp_path)
    random = np.random.default_rng(0)
    logs = {"r": random.normal(size=8), "x": random.normal(size=8)}
    assert_backends_agree_on(program, logs, [0, 3, 7])


def _controlled(folder: Path) -> Program:
    text = """
        use: {plant: plant.yaml, controller: controller.yaml}
        inputs: {r: V}
        states: {x: {unit: V, next: plant.x_next, init: x.meas}}
        connect: {plant.x: x, plant.u: controller.u, controller.error: r - x}
        outputs: {u: controller.u}
        """
    plant = """
        inputs: {x: V, u: V}
        parameters: {a: 0.5}
        outputs: {x_next: {expr: a * x + u, predicts: "x[t+1]"}}
        """
    controller = """
        inputs: {error: V}
        states: {i: {unit: V, next: i + error}}
        outputs: {u: 2 * error + i}
        """
    return model_of(folder, text, plant=plant, controller=controller).program


def test_a_vector_input_takes_a_scalar_by_repeating_it(tmp_path: Path) -> None:
    text = """
        use: {part: part.yaml}
        inputs: {x: 1}
        connect: {part.q: x}
        outputs: {y: part.y}
        """
    part = """
        dims: {joint: 3}
        inputs: {q: {dims: joint}}
        outputs: {y: sum(q.past(2))}
        """
    program = model_of(tmp_path, text, part=part).program
    np.testing.assert_array_equal(run(program, {"x": U}, t0=1), [3 * (1 + 2)])


def test_the_log_of_a_connected_input_in_init(tmp_path: Path) -> None:
    text = """
        use: {part: part.yaml}
        inputs: {x: 1}
        connect: {part.u: 3 * x}
        outputs: {y: part.y}
        """
    part = """
        inputs: {u: 1}
        states: {s: {next: s + u, init: "u.meas[t+1] + u"}}
        outputs: {y: s}
        """
    program = model_of(tmp_path, text, part=part).program
    np.testing.assert_array_equal(run(program, {"x": U}, steps=2), [3 * (2 + 1), 9 + 3])


@pytest.mark.parametrize(("method", "expected"), [("euler", 0.9), ("midpoint", 0.905)])
def test_a_part_inside_a_vector_field_is_evaluated_at_every_stage(
    tmp_path: Path, method: str, expected: float
) -> None:
    """x' = drag(x) = -x: the part takes the state of the stage. R6."""
    text = f"""
        use: {{drag: drag.yaml}}
        inputs: {{F: 1}}
        integrator: {method}
        states: {{x: {{der: (drag.force + F) / 1 s, init: 1}}}}
        connect: {{drag.v: x}}
        outputs: {{y: next(x)}}
        """
    drag = "inputs: {v: 1}\noutputs: {force: -v}\n"
    program = model_of(tmp_path, text, drag=drag).program
    np.testing.assert_allclose(run(program, {"F": [0.0]}), [expected], rtol=1e-15)


def test_what_is_connected_from_outside_is_held_over_the_step(tmp_path: Path) -> None:
    """x' = u inside the part, u = -x outside: with rk4 still 1 - dt, and not exp(-dt). R6."""
    text = """
        use: {plant: plant.yaml}
        inputs: {F: 1}
        connect: {plant.u: F - plant.x}
        outputs: {y: "next(plant.x)"}
        """
    plant = """
        inputs: {u: 1}
        states: {x: {der: u / 1 s, init: 1}}
        outputs: {out: x}
        """
    program = model_of(tmp_path, text, plant=plant).program
    np.testing.assert_allclose(run(program, {"F": [0.0]}), [0.9], rtol=1e-15)


def test_each_spec_keeps_its_integrator(tmp_path: Path) -> None:
    """docs/language.md, States (R6)."""
    text = """
        use: {a: a.yaml}
        inputs: {F: 1}
        integrator: {euler: {substeps: 2}}
        states: {x: {der: -x / 1 s, init: 1}}
        outputs: {y: "next(x) + F", z: "next(a.x)"}
        """
    part = """
        inputs: {}
        integrator: midpoint
        states: {x: {der: -x / 1 s, init: 1}}
        outputs: {out: x}
        """
    program = model_of(tmp_path, text, a=part).program
    np.testing.assert_allclose(run(program, {"F": [0.0]}), [0.95**2], rtol=1e-15)
    np.testing.assert_allclose(run(program, {"F": [0.0]}, output="z"), [0.905], rtol=1e-15)


def test_names_of_the_parent_change_no_function_of_a_part(tmp_path: Path) -> None:
    text = """
        use: {part: part.yaml}
        inputs: {sin: 1, relu: 1, i: 1, sum: 1}
        connect: {part.x: sin + relu + i + sum}
        outputs: {y: part.y}
        """
    part = """
        dims: {d: 2}
        inputs: {x: 1}
        parameters: {w: {dims: d, init: 10 * i + 1}}
        layers: {net: {mlp: {hidden: 1, activation: relu, bias: false, init: 1}}}
        outputs: {y: "sum(w) * x + sin(0 * x) + net(x)"}
        """
    program = model_of(tmp_path, text, part=part).program
    log = {"sin": [1.0], "relu": [2.0], "i": [3.0], "sum": [4.0]}
    np.testing.assert_array_equal(run(program, log), [12 * 10 + 10])


@pytest.mark.parametrize(
    ("connect", "code"),
    [
        ("part.u: part.y", "E0702"),
        ("part.u: a\n  part.y: x", "E0734"),
        ("part.v: x", "E0734"),
        ("part.u: x.past(2)", "E0736"),
    ],
)
def test_wrong_connections(tmp_path: Path, connect: str, code: str) -> None:
    text = f"use: {{part: part.yaml}}\ninputs: {{x: 1}}\nconnect:\n  {connect}\n"
    text += "equations: {a: x}\noutputs: {y: part.y}\n"
    assert [d.code for d in diagnostics(tmp_path, text, part=MEMORY)] == [code]

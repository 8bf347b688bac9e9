"""ONNX models agree with the judge in both precisions and say what their values are."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import onnx
import onnxruntime
import pytest
from numpy.typing import NDArray

from backends.onnx_model.model import build_initial_state, build_model, build_rollout, onnx_names
from backends.ports.step_interface import step_interface
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Declared, Output, Parameter, Program, Role, Signal, State
from compiler.ir.types import Type
from compiler.passes.close_loop import close_loop
from compiler.passes.to_step_form import to_step_form
from tests.every_op.agreement import assert_agrees
from tests.every_op.runners import run_onnx
from tests.language.compiled import compiled
from tests.programs import SAMPLES

ROWS = 60
TOLERANCES = {np.float64: 1e-12, np.float32: 1e-5}
"""The project's promises for one step from the judge's state."""


def run(model: onnx.ModelProto, values: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    session = onnxruntime.InferenceSession(
        model.SerializeToString(), providers=["CPUExecutionProvider"]
    )
    names = [result.name for result in session.get_outputs()]
    results = session.run(names, {name: np.asarray(value) for name, value in values.items()})
    return {name: np.asarray(value) for name, value in zip(names, results, strict=True)}


@pytest.mark.parametrize("dtype", TOLERANCES)
@pytest.mark.parametrize("name", SAMPLES)
def test_one_step_agrees_along_the_whole_record(name: str, dtype: type):
    sample = SAMPLES[name]()
    log, times = sample.log(ROWS, 3), np.arange(8, ROWS - 8)
    judge = Interpreter(sample.program)
    expected = judge.step(log, times, judge.start(log, times), losses=False)
    result = run_onnx(dtype)(sample.program, log, times)
    for output, value in expected.outputs.items():
        assert_agrees(result.outputs[output], value, TOLERANCES[dtype], output)
    for state, value in expected.next_states.items():
        assert_agrees(result.next_states[state], value, TOLERANCES[dtype], state)


@pytest.mark.parametrize("name", SAMPLES)
def test_a_rollout_is_the_step_repeated(name: str):
    sample = SAMPLES[name]()
    program = to_step_form(sample.program)
    log, steps, t0 = sample.log(ROWS, 4), 40, 8
    judge, names = Interpreter(program), onnx_names(program)
    expected = judge.rollout(log, [t0], steps)
    series = {
        port.name: _ports(program, log, name, np.arange(t0, t0 + steps))
        for name, port in _inputs(build_rollout(program), names.inputs).items()
    }
    states = {names.states[key]: v[0] for key, v in judge.start(log, [t0]).items()}
    found = run(build_rollout(program), {**series, **states})
    for output, value in expected.outputs.items():
        # 40 steps of 1e-12 each, in loops that the log feeds
        assert_agrees(found[names.outputs[output]], value[0], 1e-11, output)
    for state, value in expected.states.items():
        assert_agrees(found[names.next_states[state]], value[0], 1e-11, state)


def test_a_thousand_closed_loop_steps_agree():
    sample = SAMPLES["fir_closed_loop"]()
    program = to_step_form(close_loop(sample.program, sample.closed))
    log = sample.log(1020, 5)
    judge, names = Interpreter(program), onnx_names(program)
    expected = judge.rollout(log, [10], 1000)
    series = _ports(program, log, "F", np.arange(10, 1010))
    states = {names.states[key]: v[0] for key, v in judge.start(log, [10]).items()}
    found = run(build_rollout(program), {names.inputs["F"]: series, **states})
    # the loop is stable, so rounding does not grow: 1e-9 over 1,000 steps is the promise
    assert_agrees(found[names.outputs["x_next"]], expected.outputs["x_next"][0], 1e-9, "x_next")


def test_a_program_without_inputs_is_rolled_out_by_a_clock():
    b, starts = GraphBuilder(), GraphBuilder()
    x = b.state("x", Type())
    half = b.multiply(x, b.constant(0.5))
    state = State("x", (), None, Declared(), half, starts.constant(8.0))
    program = Program(
        "halving", 0.1, (), (), (state,), b.graph(), starts.graph(), (Output("y", x),)
    )
    assert run(build_initial_state(program), {})["x"] == 8.0
    found = run(build_rollout(program), {"x": np.array(8.0), "steps": np.zeros(4)})
    assert found["y"].tolist() == [8.0, 4.0, 2.0, 1.0]
    assert found["x_next"] == 0.5


def test_values_carry_units_axes_and_lags():
    model = build_model(to_step_form(SAMPLES["joint_arm"]().program))
    angles = model.graph.input[0]
    assert (angles.name, angles.doc_string) == ("q", "Joint angles [rad]")
    (dimension,) = angles.type.tensor_type.shape.dim
    assert (dimension.dim_value, dimension.denotation) == (3, "joint")
    late = build_model(to_step_form(SAMPLES["late_sensor"]().program))
    assert "samples late" in late.graph.input[0].doc_string


GRID = """\
dims: {row: 2, column: 3}
inputs: {q: {unit: m, dims: [row, column]}, u: 1}
states:
  x: {next: "x + sum(q[t-2:t]) + u", init: "x.meas + x.meas[t-1] - x.meas[t+1]", unit: m}
outputs: {y: {expr: "2 * q", unit: m}, z: x}
"""


def test_every_dimension_names_its_axis_in_order():
    """Axes in the order of the spec, `steps` before them, the window last."""
    program = to_step_form(compiled(GRID))
    step, rollout = build_model(program), build_rollout(program)
    buffer = next(value for value in step.graph.input if value.name == "q_history")
    assert _axes(step.graph.input[0]) == [("row", 2), ("column", 3)]
    assert _axes(step.graph.output[0]) == [("row", 2), ("column", 3)]
    assert [name for name, _ in _axes(buffer)][:2] == ["row", "column"]
    assert _axes(buffer)[2][1] == 2
    series = next(value for value in rollout.graph.input if value.name == "q")
    assert _axes(series) == [("steps", "steps"), ("row", 2), ("column", 3)]
    (window,) = (v for v in build_initial_state(program).graph.input if v.name == "x_window")
    assert window.doc_string == "samples -1 … 1 around the start [m]"


def test_a_model_names_its_spec_and_the_operators_that_runtimes_must_know():
    program = replace(to_step_form(compiled(GRID)), spec_hash="0123abcd", doc="A grid")
    for build in (build_model, build_rollout, build_initial_state):
        model = build(program)
        entries = {entry.key: entry.value for entry in model.metadata_props}
        assert (entries["model"], entries["spec_sha256"]) == ("test", "0123abcd")
        assert [(opset.domain, opset.version) for opset in model.opset_import] == [("", 17)]
        assert (model.ir_version, model.producer_name, model.doc_string) == (8, "msnn", "A grid")


def _axes(value: onnx.ValueInfoProto) -> list[tuple[str, int | str]]:
    dimensions = value.type.tensor_type.shape.dim
    return [(axis.denotation, axis.dim_param or axis.dim_value) for axis in dimensions]


def test_the_model_describes_its_interface():
    program = to_step_form(SAMPLES["joint_arm"]().program)
    for build, kind in ((build_model, "step"), (build_rollout, "rollout")):
        entries = {entry.key: entry.value for entry in build(program).metadata_props}
        assert entries["kind"] == kind
        assert entries["sample_time"] == "0.001"
        assert json.loads(entries["interface"])["outputs"][0]["port"] == "q_next"


def test_parameters_are_initialisers_that_may_be_replaced():
    program = to_step_form(SAMPLES["fir_closed_loop"]().program)
    model = build_model(program, {"g.weight": np.array([5.0])})
    values = {t.name: onnx.numpy_helper.to_array(t) for t in model.graph.initializer}
    assert values["g_weight"] == [5.0]
    assert values["h_weight"].dtype == np.float64
    single = build_model(program, dtype=np.float32)
    assert all(t.data_type != onnx.TensorProto.DOUBLE for t in single.graph.initializer)


@pytest.mark.parametrize("place", [0, 1])
@pytest.mark.parametrize("operation", ["add", "subtract", "multiply", "divide"])
def test_an_operand_near_0_or_1_is_not_dropped(operation: str, place: int):
    """onnxruntime compares it in single precision."""
    weight, u = (1e-50, 1e-49) if operation in ("add", "subtract") else (1 + 1e-8, 3.0)
    b = GraphBuilder()
    operands = [b.parameter("p", Type()), b.negate(b.signal("u", 0, 0, Type()))]
    y = b.negate(getattr(b, operation)(*(operands if place == 0 else operands[::-1])))
    program = Program(
        "near", None, (Signal("u", Role.INPUT),), (Parameter("p", initial=(weight,)),), (),
        b.graph(), GraphBuilder().graph(), (Output("y", y),),
    )  # fmt: skip
    exact = Interpreter(program).step({"u": np.array([u])}, np.array([0]), {}).outputs["y"]
    found = run(build_model(program), {"u": np.array(u)})["y"]
    np.testing.assert_allclose(found, exact[0], rtol=1e-15)


def test_the_same_program_gives_the_same_bytes():
    program = to_step_form(SAMPLES["fuzzy_local_models"]().program)
    first, second = build_rollout(program), build_rollout(program)
    assert first.SerializeToString(deterministic=True) == second.SerializeToString(
        deterministic=True
    )


def test_other_precisions_are_refused():
    program = to_step_form(SAMPLES["fir_closed_loop"]().program)
    with pytest.raises(ValueError, match="float16"):
        build_model(program, dtype=np.float16)


def test_a_program_without_states_has_no_first_states():
    b = GraphBuilder()
    output = Output("y", b.constant(1.0))
    program = Program("one", None, (), (), (), b.graph(), GraphBuilder().graph(), (output,))
    with pytest.raises(ValueError, match="no states"):
        build_initial_state(program)


def _inputs(model: onnx.ModelProto, names: dict[str, str]) -> dict[str, onnx.ValueInfoProto]:
    by_port = {value.name: value for value in model.graph.input}
    return {name: by_port[port] for name, port in names.items()}


def _ports(
    program: Program, log: dict[str, NDArray[np.float64]], name: str, times: NDArray[np.int64]
) -> NDArray[np.float64]:
    """The value of an input's port at every time: one sample, or a window with the axis last."""
    port = next(p for p in step_interface(program).inputs if p.signal.name == name)
    rows = np.stack([log[name][t + port.first : t + port.last + 1] for t in times])
    return np.moveaxis(rows, 1, -1).reshape(len(times), *port.type.shape)

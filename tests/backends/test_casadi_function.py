"""CasADi steps agree with the judge, keep their names and shapes, and stay in matrix form."""

from __future__ import annotations

import math

import casadi
import numpy as np
import pytest

from backends.casadi_function.function import build_function, build_initial_state, casadi_names
from backends.casadi_function.options import Form
from backends.ports.step_interface import step_interface
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Declared, Output, Program, Role, Signal, State
from compiler.ir.types import WINDOW, Axis, Type
from compiler.passes.close_loop import close_loop
from compiler.passes.to_step_form import to_step_form
from tests.every_op.agreement import assert_agrees
from tests.every_op.runners import run_casadi
from tests.programs import SAMPLES

ROWS = 60
STEP = 1e-12
"""The project's promise for one step from the judge's state."""


@pytest.mark.parametrize("name", SAMPLES)
def test_one_step_agrees_along_the_whole_record(name: str):
    sample = SAMPLES[name]()
    log, times = sample.log(ROWS, 3), np.arange(8, ROWS - 8)
    judge = Interpreter(sample.program)
    expected = judge.step(log, times, judge.start(log, times), losses=False)
    result = run_casadi(sample.program, log, times)
    for output, value in expected.outputs.items():
        assert_agrees(result.outputs[output], value, STEP, output)
    for state, value in expected.next_states.items():
        assert_agrees(result.next_states[state], value, STEP, state)


def test_a_thousand_closed_loop_steps_agree():
    sample = SAMPLES["fir_closed_loop"]()
    program = to_step_form(close_loop(sample.program, sample.closed))
    log = sample.log(1020, 5)
    expected = Interpreter(program).rollout(log, [10], 1000)
    step, names = build_function(program), casadi_names(program)
    interface = step_interface(program)
    state = Interpreter(program).start(log, [10])
    columns = {names.states[key]: value[0].ravel() for key, value in state.items()}
    weights = {names.parameters[p.name]: list(p.initial) for p in interface.parameters}
    (port,) = interface.inputs
    found: list[float] = []
    for t in range(10, 1010):
        values = step.call({names.inputs["F"]: log["F"][t + port.first], **columns, **weights})
        columns = {names.states[s.name]: values[names.next_states[s.name]] for s in program.states}
        found.append(float(values[names.outputs["x_next"]]))
    # the loop is stable, so rounding does not grow: 1e-9 over 1,000 steps is the promise
    assert_agrees(np.array([found]), expected.outputs["x_next"], 1e-9, "x_next")


def test_ports_are_named_columns_in_a_stated_order():
    program = to_step_form(SAMPLES["joint_arm"]().program)
    step, start = build_function(program), build_initial_state(program)
    assert step.name_in() == ["q", "tau", "q_history", "own_weight", "coupling", "shape"]
    assert step.name_out() == ["q_next", "q_shown", "q_history_next"]
    assert [step.size_in(i) for i in range(3)] == [(3, 1), (3, 1), (9, 1)]
    assert start.name_in() == ["q_window"]
    assert start.name_out() == ["q_history"]


def test_an_output_may_be_called_as_the_next_value_of_a_state():
    b = GraphBuilder()
    x = b.state("x", Type())
    program = _program(b, Output("x_next", b.negate(x)), next=x)
    assert build_function(program).name_out() == ["x_next", "x_next_state"]
    assert casadi_names(program).next_states == {"x": "x_next_state"}


def test_names_of_a_spec_become_names_that_casadi_takes():
    b = GraphBuilder()
    x = b.state("x", Type())
    kept = [Output(name, b.negate(x)) for name in ("jac", "hess", "null")]
    program = _program(b, *kept, Output("ρ__1.β", x), next=x)
    named = build_function(program).name_out()[:4]
    assert named == ["jac_2", "hess_2", "null_2", "rho_1_beta"]


def test_a_window_stays_one_product():
    b = GraphBuilder()
    taps = Axis(WINDOW, 200)
    window = b.signal("u", -199, 0, Type((taps,)))
    y = b.contract(window, b.constant(np.linspace(0, 1, 200), (taps,)))
    program = Program(
        name="long",
        sample_time=0.1,
        signals=(Signal("u", Role.INPUT),),
        parameters=(),
        states=(),
        step=b.graph(),
        start=GraphBuilder().graph(),
        outputs=(Output("y", y),),
    )
    step = build_function(to_step_form(program))
    operations = [step.instruction_id(i) for i in range(step.n_instructions())]
    assert operations.count(casadi.OP_MTIMES) == 1
    # two inputs, two outputs, two constants, the window put together, turned and cut, the product
    assert len(operations) == 10


@pytest.mark.parametrize(("form", "calls"), [("mx", 2), ("sx", 0)])
def test_a_problem_of_many_steps_keeps_one_copy_of_the_step(form: Form, calls: int):
    """Also where it is expanded to numbers, unless the step was made of such itself."""
    step = build_function(to_step_form(SAMPLES["joint_arm"]().program), form=form)
    symbols = [casadi.MX.sym(name, *step.size_in(name)) for name in step.name_in()]
    first = step(*symbols)
    second = step(first[0], symbols[1], first[2], *symbols[3:])
    twice = casadi.Function("twice", symbols, [second[0]])
    assert _calls(twice) == 2
    assert _calls(twice.expand()) == calls


@pytest.mark.parametrize("x", [-800.0, -400.0, -30.0, -1.0, 0.0, 1.0, 30.0, 800.0])
def test_sigmoid_and_softplus_have_exact_slopes_of_both_orders(x: float):
    """A solver asks for both; e^−|x| has none at 0, and e^−x overflows in the slope first."""
    b = GraphBuilder()
    x_node = b.state("x", Type())
    outputs = [Output(name, b.apply(name, x_node)) for name in ("sigmoid", "softplus")]
    step, at = build_function(_program(b, *outputs, next=x_node)), casadi.MX.sym("at")
    values = step.call({"x": at})
    tail = math.exp(-abs(x))
    share, rest = (1.0 if x >= 0 else tail) / (1 + tail), (1.0 if x < 0 else tail) / (1 + tail)
    wanted = {
        "sigmoid": (share * rest, share * rest * (rest - share)),
        "softplus": (share, share * rest),
    }
    for name, slopes in wanted.items():
        slope = casadi.jacobian(values[name], at)
        curvature = casadi.jacobian(slope, at)
        found = casadi.Function("f", [at], [slope, curvature])(x)
        # a slope of 1 leaves of 1 − e^−x what rounds it
        for one, exact in zip(found, slopes, strict=True):
            assert float(one) == pytest.approx(exact, rel=1e-13, abs=1e-16 if x > 0 else 0.0)


def test_building_leaves_casadi_as_it_was():
    before = casadi.GlobalOptions.getSimplificationOnTheFly()
    build_function(to_step_form(SAMPLES["spring_damper_rk4"]().program))
    assert casadi.GlobalOptions.getSimplificationOnTheFly() == before


def _calls(function: casadi.Function) -> int:
    operations = [function.instruction_id(i) for i in range(function.n_instructions())]
    return operations.count(casadi.OP_CALL)


def _program(b: GraphBuilder, *outputs: Output, next: int) -> Program:
    starts = GraphBuilder()
    state = State("x", (), None, Declared(), next, starts.constant(1.0))
    return Program("names", 0.1, (), (), (state,), b.graph(), starts.graph(), outputs)

"""The Hessians of the gallery's models are those that CasADi finds, as sparse or sparser."""

from __future__ import annotations

import casadi
import numpy as np
import pytest

from backends.casadi_function.function import build_function, casadi_names
from compiler.hessian.step_derivatives import (
    DerivativeInterpreter,
    StepDerivatives,
    multiplier,
    next_value,
    step_derivatives,
)
from compiler.interpreter.interpreter import physical_weights
from compiler.ir.program import Program
from msnn.agreement.judge import Arrays, judge
from msnn.agreement.judgement import drawn_record
from tests.examples.test_jacobians import PROGRAMS

STEPS = 5


@pytest.mark.parametrize("name", PROGRAMS)
def test_casadi_finds_the_same(name: str) -> None:
    program = PROGRAMS[name]()
    found = step_derivatives(program)
    weights = physical_weights(program, {})
    record = drawn_record(program, "drawn")
    run = judge(program, weights, record, np.float64)
    random = np.random.default_rng(3)
    lambdas = {
        m.name: random.uniform(0.5, 1.5, [axis.size for axis in m.axes])
        for m in found.results.members
    }
    theirs, names = _casadi(program, found, lambdas)
    batch = {multiplier(result): value[np.newaxis] for result, value in lambdas.items()}
    own = DerivativeInterpreter(found, program, weights)
    for k in range(STEPS):
        states: Arrays = {state: values[k] for state, values in run.states.items()}
        members = batch | {state: value[np.newaxis] for state, value in states.items()}
        values = own.values(record.log, record.t0 + k, members)
        inputs = {port: values[k] for port, values in run.inputs.items()}
        tables = {"u": inputs, "x": states, "p": weights}
        arguments = [np.ravel(tables[kind][port]) for kind, port in names]
        slopes, curvature = theirs(*arguments)
        for matrix, expected in (("J", np.array(slopes)), ("H", np.array(curvature))):
            scale = max(1.0, float(np.abs(expected).max(initial=0.0)))
            # both are exact; terms of sums cancel in another order
            np.testing.assert_allclose(
                values.matrices[matrix][0], expected, rtol=0, atol=1e-9 * scale, err_msg=matrix
            )


@pytest.mark.parametrize("name", PROGRAMS)
def test_results_are_those_of_the_step_to_the_bit(name: str) -> None:
    program = PROGRAMS[name]()
    found = step_derivatives(program, hessian=False)
    weights = physical_weights(program, {})
    record = drawn_record(program, "drawn")
    run = judge(program, weights, record, np.float64)
    own = DerivativeInterpreter(found, program, weights)
    for k in range(STEPS):
        states = {state: values[k][np.newaxis] for state, values in run.states.items()}
        results = own.values(record.log, record.t0 + k, states).results
        for name, values in run.outputs.items():
            np.testing.assert_array_equal(results[name][0], values[k])


@pytest.mark.parametrize("level", [0.0, 1e-9])
def test_empty_tanks_have_finite_curvature_in_casadi_too(level: float) -> None:
    """The level is below 0 in the second substep, where the root has an infinite slope."""
    program = PROGRAMS["two_tanks"]()
    found = step_derivatives(program)
    lambdas = {m.name: np.ones([a.size for a in m.axes]) for m in found.results.members}
    weights = physical_weights(program, {})
    theirs, names = _casadi(program, found, lambdas)
    given = {"u": {"pump": 0.0}, "x": {"upper": level, "lower": level}, "p": weights}
    _, expected = theirs(*(np.ravel(given[kind][port]) for kind, port in names))
    states = {name: np.full(1, value) for name, value in given["x"].items()}
    states |= {multiplier(result): value[np.newaxis] for result, value in lambdas.items()}
    own = DerivativeInterpreter(found, program, weights)
    values = own.values({"pump": np.zeros(1)}, 0, states).matrices["H"][0]
    if level:
        assert np.isfinite(values).all()
        np.testing.assert_allclose(values, np.array(expected), rtol=1e-12)
    else:
        assert np.isfinite(np.array(expected)).all()
        assert np.isinf(values[0, 0])  # where CasADi has 0


def _casadi(
    program: Program, found: StepDerivatives, lambdas: Arrays
) -> tuple[casadi.Function, list[tuple[str, str]]]:
    """J and the Hessian of λᵀ results in the same variables, and what the arguments are."""
    step, names = build_function(program), casadi_names(program)
    ports = {"u": names.inputs, "x": names.states, "p": names.parameters}
    given = {port: (kind, name) for kind, table in ports.items() for name, port in table.items()}
    symbols = {
        step.name_in(i): casadi.MX.sym(step.name_in(i), step.size1_in(i))
        for i in range(step.n_in())
    }
    results = step.call(symbols)
    ends = {next_value(state): port for state, port in names.next_states.items()} | names.outputs
    rows = casadi.vertcat(*(results[ends[m.name]] for m in found.results.members))
    states = {state.name for state in program.states}
    columns = [
        symbols[(names.states if m.name in states else names.inputs)[m.name]]
        for m in found.variables.members
    ]
    point = casadi.MX.sym("point", sum(column.size1() for column in columns))
    split = np.cumsum([0, *(column.size1() for column in columns)]).tolist()
    moved = casadi.substitute([rows], columns, casadi.vertsplit(point, split))[0]
    weight = np.concatenate([np.ravel(lambdas[m.name]) for m in found.results.members])
    total = casadi.dot(casadi.DM(weight), moved)
    wanted = [casadi.jacobian(moved, point), casadi.hessian(total, point)[0]]
    wanted = casadi.substitute(wanted, [point], [casadi.vertcat(*columns)])
    return casadi.Function("derivatives", list(symbols.values()), wanted), [
        given[port] for port in symbols
    ]

"""The Jacobians of the gallery's models are those that CasADi finds, and at least as sparse."""

from __future__ import annotations

import casadi
import numpy as np
import pytest

from backends.casadi_function.function import build_function, casadi_names
from compiler.interpreter.interpreter import physical_weights
from compiler.ir.program import Program
from compiler.jacobian.jacobian import JacobianInterpreter, jacobian
from compiler.jacobian.matrices import Matrix
from compiler.passes.to_step_form import to_step_form
from msnn.agreement.judge import Arrays, judge
from msnn.agreement.judgement import drawn_record
from msnn.exports.export import plan_exports
from msnn.model.load import load_model
from spec_schema.diagnostics.diagnostic import Findings
from tests.examples.gallery import GALLERY, NAMES, spec_of
from tests.programs import SAMPLES

EXACT = 1e-10
"""Both are exact; terms of sums cancel in another order."""
STEPS = 5


def _of_gallery(name: str) -> Program:
    findings = Findings()
    model = load_model(spec_of(GALLERY, name))
    (plan,) = plan_exports(model, ["c"], findings, ["jacobian"])
    assert not findings.failed
    return plan.program


PROGRAMS = {
    **{name: lambda name=name: _of_gallery(name) for name in NAMES},
    "joint_arm": lambda: to_step_form(SAMPLES["joint_arm"]().program),
}

ARRAYS_WITH_ZEROS = {"arm_friction", "lane_keeper"}
"""Filters and fuzzy sets in which single numbers of a constant array are 0: these stay products."""


@pytest.mark.parametrize("name", PROGRAMS)
def test_casadi_finds_the_same(name: str) -> None:
    program = PROGRAMS[name]()
    slopes = jacobian(program, parameters=True)
    weights = physical_weights(program, {})
    record = drawn_record(program, "drawn")
    run = judge(program, weights, record, np.float64)
    own = JacobianInterpreter(slopes, program, weights)
    functions = {matrix.name: _casadi(program, matrix) for matrix in slopes.matrices}
    for k in range(STEPS):
        states = {state: values[k] for state, values in run.states.items()}
        batch = {state: value[np.newaxis] for state, value in states.items()}
        found = own.matrices(record.log, record.t0 + k, batch)
        inputs = {port: values[k] for port, values in run.inputs.items()}
        for matrix in slopes.matrices:
            function, arguments = functions[matrix.name]
            values = [_column(given, inputs, states, weights) for given in arguments]
            expected = np.array(function(*values)).reshape(matrix.shape)
            scale = max(1.0, float(np.abs(expected).max(initial=0.0)))
            np.testing.assert_allclose(found[matrix.name][0], expected, rtol=0, atol=EXACT * scale)


@pytest.mark.parametrize("name", sorted(PROGRAMS.keys() - ARRAYS_WITH_ZEROS))
def test_no_entry_is_computed_that_casadi_knows_to_be_zero(name: str) -> None:
    program = PROGRAMS[name]()
    for matrix in jacobian(program, parameters=True).matrices:
        if matrix.size:
            function, _ = _casadi(program, matrix)
            may_differ = np.array(casadi.DM.ones(function.sparsity_out(0)), dtype=bool)
            ours = np.array([known != 0.0 for known in matrix.known]).reshape(matrix.shape)
            assert not (ours & ~may_differ).any(), matrix.name


Given = tuple[str, str]
"""Vector and name of what an argument is."""


def _casadi(program: Program, matrix: Matrix) -> tuple[casadi.Function, list[Given]]:
    """CasADi's Jacobian of all rows by all columns, and what its arguments are."""
    step, names = build_function(program), casadi_names(program)
    ports = {"u": names.inputs, "x": names.states, "p": names.parameters}
    given = {port: (kind, name) for kind, table in ports.items() for name, port in table.items()}
    arguments = {
        step.name_in(i): casadi.MX.sym(step.name_in(i), step.size1_in(i))
        for i in range(step.n_in())
    }
    results = step.call(arguments)
    ends = names.next_states if matrix.rows.letter == "x" else names.outputs
    rows = casadi.vertcat(*(results[ends[member.name]] for member in matrix.rows.members))
    columns = [arguments[ports[matrix.columns.letter][m.name]] for m in matrix.columns.members]
    total = casadi.vertcat(*columns)
    point = casadi.MX.sym("point", total.size1())
    split = np.cumsum([0, *(column.size1() for column in columns)]).tolist()
    if columns:
        moved = casadi.substitute([rows], columns, casadi.vertsplit(point, split))[0]
        slope = casadi.substitute([casadi.jacobian(moved, point)], [point], [total])[0]
    else:
        slope = casadi.MX(rows.size1(), 0)
    function = casadi.Function("slopes", list(arguments.values()), [slope])
    return function, [given[port] for port in arguments]


def _column(given: Given, inputs: Arrays, states: Arrays, weights: Arrays) -> np.ndarray:
    kind, name = given
    return {"u": inputs, "x": states, "p": weights}[kind][name].ravel()

"""`export --check` compares Jacobians, where slopes are infinite too."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import msnn
from backends.c import COptions
from compiler.ir.program import Program
from compiler.passes.simplify import prune_outputs
from compiler.passes.to_step_form import to_step_form
from msnn.agreement.jacobian import points
from msnn.agreement.judge import judge
from msnn.agreement.judgement import drawn_record
from msnn.exports.export import load_export, plan_exports, write_export
from msnn.exports.target import AnyPlan
from msnn.model.load import load_model
from msnn.model.weights.weights_file import initial_weights
from spec_schema.diagnostics.diagnostic import Findings
from tests.agreement.exported import checked, plan_of
from tests.conditions import require_tool
from tests.examples.gallery import GALLERY, spec_of
from tests.language.compiled import compiled

TWO_TANKS = spec_of(GALLERY, "two_tanks")


def tanks() -> AnyPlan:
    (plan,) = plan_exports(load_model(TWO_TANKS), ["casadi"], Findings())
    return plan


def test_casadi_differentiates_empty_tanks_as_linearize_does(tmp_path: Path) -> None:
    """In the second substep the levels are below 0, where the root has an infinite slope."""
    plan = tanks()
    inputs, states = {"pump": np.array(0.0)}, {"upper": np.array(1e-9), "lower": np.array(1e-9)}
    wanted = msnn.linearize(msnn.load(TWO_TANKS), inputs, states).matrices
    with load_export(plan, write_export(plan, {}, tmp_path)) as loaded:
        slopes = loaded.slopes()
        assert slopes is not None
        one = {name: value[np.newaxis] for name, value in inputs.items()}
        found = slopes.at(one, {n: v[np.newaxis] for n, v in states.items()}, 1)
    for name, matrix in wanted.items():
        np.testing.assert_allclose(found[name][0], matrix, rtol=1e-12, err_msg=name)
        assert np.isfinite(matrix).all()


def test_an_export_that_multiplies_0_by_infinity_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = tanks()
    weights = initial_weights(plan.program)
    assert checked(plan, weights, tmp_path / "guarded").agrees

    def unguarded(program: Program) -> Program:
        return program

    monkeypatch.setattr("backends.casadi_function.function.guard_infinite_slopes", unguarded)
    found = checked(plan, weights, tmp_path / "unguarded")
    assert not found.agrees
    assert found.one_step == found.free_run == 0.0
    assert {fault.of for fault in found.faults} >= {"the matrix A", "the matrix C"}


STEEP = """
inputs: {u: {range: [0, 4]}, w: {range: [0, 1]}}
parameters: {a: 0.5}
states: {x: {next: "0.5 * x + a * sqrt(u) + abs(w)", init: 0}}
outputs: {y: "x + sqrt(u * w)", z: "log(w)"}
"""


@pytest.mark.parametrize("target", ["casadi", "c"])
def test_slopes_that_are_infinite_agree_too(target: str, tmp_path: Path) -> None:
    """Where `z` is infinite it has no slopes; those of `y` are infinite, or 0 · ∞."""
    require_tool("gcc", install="apt install gcc")
    plan = plan_of(target, to_step_form(compiled(STEEP)), "float64")
    if target == "c":
        plan = replace(plan, options=COptions(extras=("jacobian", "parameter_jacobian")))
    found = checked(plan, initial_weights(plan.program), tmp_path)
    assert found.agrees, found
    assert found.jacobian is not None
    assert found.jacobian <= 1e-12


def spoil(patch: pytest.MonkeyPatch, spoiled: Callable[[np.ndarray], np.ndarray]) -> None:
    """Lets exports to CasADi compute other matrices."""
    from msnn.exports.targets import casadi

    plain = casadi._CasadiExport._matrix

    def matrix(*arguments: object) -> np.ndarray:
        return spoiled(plain(*arguments))  # pyright: ignore[reportArgumentType]

    patch.setattr(casadi._CasadiExport, "_matrix", matrix)


@pytest.mark.parametrize("change", [lambda x: x * (1 + 1e-9), lambda x: -x, lambda x: x * np.nan])
def test_a_wrong_entry_is_found(
    change: Callable[[np.ndarray], np.ndarray], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def first_entry(matrix: np.ndarray) -> np.ndarray:
        matrix.flat[:1] = change(matrix.flat[:1])
        return matrix

    spoil(monkeypatch, first_entry)
    plan = tanks()
    found = checked(plan, initial_weights(plan.program), tmp_path)
    assert [fault.of for fault in found.faults if fault.of == "the matrix A"]


@pytest.mark.parametrize(("factor", "agrees"), [(1.0, True), (1 + 1e-9, False)])
def test_slopes_by_a_parameter_of_0_are_compared_by_their_own_size(
    factor: float, agrees: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No value of b says how large its slope may be."""
    spoil(monkeypatch, lambda matrix: matrix * factor)
    model = compiled("inputs: {u: 1}\nparameters: {b: 0}\noutputs: {y: b * u}\n")
    plan = plan_of("casadi", to_step_form(model), "float64")
    found = checked(plan, {"b": np.array(0.0)}, tmp_path)
    assert found.agrees == agrees
    assert ("the matrix dy_dp" in {fault.of for fault in found.faults}) != agrees


FAST = """
inputs: {u: {range: [0, 1]}}
parameters: {p: 1, q: 1, r: 1}
outputs: {y: "cos(p * cos(q * sin(u)))", z: "sqrt(u) * r"}
"""


@pytest.mark.parametrize("factor", [1.0, 1 + 1e-3])
def test_an_entry_is_as_right_as_float64_can_be(
    factor: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The rounding of 1e9·x is seven digits of its cosine; 1e-50 of 1e30 is not steep."""
    spoil(monkeypatch, lambda matrix: matrix * factor)
    plan = plan_of("casadi", to_step_form(compiled(FAST)), "float64")
    large = {"p": np.array(1e9), "q": np.array(1e3), "r": np.array(1e-50)}
    found = checked(plan, large, tmp_path)
    assert found.agrees == (factor == 1.0), found


def test_points_without_a_bound_of_rounding_are_counted(tmp_path: Path) -> None:
    plan = plan_of("casadi", to_step_form(compiled(FAST)), "float64")
    large = {"p": np.array(1e100), "q": np.array(1e100), "r": np.array(1.0)}
    found = checked(plan, large, tmp_path)
    assert found.agrees, found
    assert found.undecided["the matrix D"] > 0


@pytest.mark.parametrize("factor", [1e-24, -1.0])
def test_a_slope_in_place_of_an_infinite_one_is_as_steep_and_has_its_direction(
    factor: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = plan_of("casadi", to_step_form(compiled(STEEP)), "float64")
    assert checked(plan, initial_weights(plan.program), tmp_path / "right").agrees
    spoil(monkeypatch, lambda matrix: np.where(np.abs(matrix) > 1e20, factor * matrix, matrix))
    found = checked(plan, initial_weights(plan.program), tmp_path / "wrong")
    assert {fault.of for fault in found.faults} >= {"the matrix B"}


def test_points_are_the_same_every_time_and_within_their_ranges() -> None:
    program = tanks().program
    program = to_step_form(prune_outputs(program, [output.name for output in program.outputs]))
    run = judge(program, {}, drawn_record(program, "drawn"), np.float64)
    first, again = points(program, run), points(program, run)
    for name, values in {**first.inputs, **first.states}.items():
        np.testing.assert_array_equal(values, {**again.inputs, **again.states}[name])
    pump, upper = first.inputs["pump"], first.states["upper"]
    assert len(pump) == len(upper) == first.count
    assert (pump.min(), pump.max()) == (0, 10)
    assert (upper.min(), upper.max()) == (0, 12)
    assert ((pump == 0) & (upper == 1e-9) & (first.states["lower"] == 1e-9)).any()

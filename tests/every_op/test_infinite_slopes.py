"""One meaning of infinite slopes: a product with a factor 0 is 0, whichever factor it is."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from backends.c import COptions
from backends.c.interface.status import StatusBit
from compiler.differentiation.forward_mode import tangents
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.builder import GraphBuilder, with_step
from compiler.ir.ops import ReadSignal
from compiler.ir.program import Output, Program
from compiler.ir.types import Axis
from compiler.passes.guard_derivatives import STEEP
from compiler.passes.simplify import prune_outputs
from compiler.passes.to_step_form import to_step_form
from msnn.simulation.linearize import linearize
from tests.backends.c.c_programs import built
from tests.conditions import require_tool
from tests.language.compiled import compiled

INF = math.inf

CASES: dict[str, tuple[str, float, float, float, float]] = {
    # formula, x, k, and the slopes in x and in k
    "root_of_what_a_max_holds_at_0": ("sqrt(max(x, 0)) + k", -1.0, 0.0, 0.0, 1.0),
    "root_at_0": ("sqrt(max(x, 0)) + k", 0.0, 0.0, INF, 1.0),
    "factor_0_after_the_root": ("k * sqrt(x)", 0.0, 0.0, 0.0, 0.0),
    "factor_0_before_the_root": ("sqrt(k * x)", 1.0, 0.0, 0.0, INF),
    "odd_root": ("where(x > 0, sqrt(abs(x)), -sqrt(abs(x))) + k", 0.0, 0.0, 0.0, 1.0),
    "quotient_that_a_min_bounds": ("min(1 / x, 5) + k", 0.0, 0.0, 0.0, 1.0),
    "quotient_that_saturates": ("atan(1 / x) + k", 0.0, 0.0, 0.0, 1.0),
    "power_above_1": ("x**1.5 + k", 0.0, 0.0, 0.0, 1.0),
    "power_below_1": ("x**0.5 + k", 0.0, 0.0, INF, 1.0),
    "power_of_0_to_0": ("where(k <= 0, x**k, 1)", 0.0, 0.0, 0.0, -INF),
    "asin_that_is_clipped": ("asin(clip(x, -1, 1)) + k", 2.0, 0.0, 0.0, 1.0),
    "asin_at_1": ("asin(x) + k", 1.0, 0.0, INF, 1.0),
    "acos_at_minus_1": ("acos(x) + k", -1.0, 0.0, -INF, 1.0),
    "logarithm_that_a_max_bounds": ("max(log(x), -5) + k", 0.0, 0.0, 0.0, 1.0),
    "root_of_a_sum_of_squares": ("sqrt(x * x + k * k)", 0.0, 0.0, 0.0, 0.0),
    "two_roots": ("sqrt(sqrt(max(x, 0))) + k", -1.0, 0.0, 0.0, 1.0),
    "matrix_of_zeros": ("sum(sqrt(x) * z) + k", 0.0, 0.0, 0.0, 1.0),
    "product_of_matrices": ("sum((z * sqrt(x)) @ Z) + k", 0.0, 0.0, 0.0, 1.0),
}
INPUTS = ("x", "k")


ZEROS = "z: {dims: row, init: 0, learn: false}, Z: {dims: [row, column], init: 0, learn: false}"


def case_program(formula: str) -> Program:
    return compiled(f"""
        inputs: {{x: {{}}, k: {{}}}}
        dims: {{row: 2, column: 2}}
        parameters: {{{ZEROS}}}
        outputs: {{y: "{formula} + 0 * x"}}
        """)


@pytest.fixture(params=CASES)
def case(request: pytest.FixtureRequest) -> tuple[str, float, float, float, float]:
    return CASES[request.param]


def agrees(found: np.ndarray, wanted: np.ndarray) -> bool:
    return bool(np.array_equal(found.ravel(), wanted.ravel()))


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_reverse_mode(case: tuple[str, float, float, float, float]) -> None:
    formula, x, k, *wanted = case
    found = linearize(case_program(formula), {"x": x, "k": k}, {}, weights_of(formula))
    assert agrees(found.matrices["D"], np.array(wanted))


def weights_of(formula: str) -> dict[str, np.ndarray]:
    return {p.name: np.zeros([a.size for a in p.axes]) for p in case_program(formula).parameters}


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_forward_mode(case: tuple[str, float, float, float, float]) -> None:
    formula, x, k, *wanted = case
    program = case_program(formula)
    directions = Axis("direction", 2)
    builder = GraphBuilder(program.step)
    seeds = {
        index: builder.constant(np.eye(2)[INPUTS.index(node.op.signal)], (directions,))
        for index, node in program.step
        if isinstance(node.op, ReadSignal)
    }
    (output,) = program.outputs
    found = tangents(builder, directions, seeds, {})
    whole = with_step(program, builder.graph(), {output.node: output.node})
    whole = Program(
        name="slopes",
        sample_time=whole.sample_time,
        signals=whole.signals,
        parameters=whole.parameters,
        states=(),
        step=builder.graph(),
        start=whole.start,
        outputs=(Output("slopes", found[output.node]),),
        losses=(),
    )
    log = {"x": np.array([x]), "k": np.array([k])}
    step = Interpreter(whole, weights_of(formula)).step(log, [0], {}, losses=False)
    assert agrees(step.outputs["slopes"], np.array(wanted))


def stands_for(found: np.ndarray, wanted: np.ndarray) -> bool:
    """A library that differentiates by itself has ±STEEP and its multiples for ±∞."""
    found = np.where(np.abs(found) >= 1e-2 * STEEP, np.copysign(INF, found), found)
    return agrees(found, wanted)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_torch(case: tuple[str, float, float, float, float]) -> None:
    import torch

    from backends.torch_module.module import build_module

    formula, x, k, *wanted = case
    program = to_step_form(prune_outputs(case_program(formula), ["y"]))
    module = build_module(program, torch.float64)
    given = {
        name: torch.tensor([value], dtype=torch.float64, requires_grad=True)
        for name, value in (("x", x), ("k", k))
    }
    step = module.step(given, torch.tensor([0]), {})
    step.outputs["y"].sum().backward()
    slopes = [given[name].grad for name in INPUTS]
    found = np.array([np.nan if slope is None else float(slope) for slope in slopes])
    assert stands_for(found, np.array(wanted))


def test_casadi(case: tuple[str, float, float, float, float]) -> None:
    from backends.casadi_function.function import build_function

    formula, x, k, *wanted = case
    program = to_step_form(prune_outputs(case_program(formula), ["y"]))
    step = build_function(program, "m")
    import casadi

    symbols = {name: casadi.MX.sym(name) for name in INPUTS}
    zeros = {p: 0 for p in step.name_in() if p not in INPUTS}
    value = step(**symbols, **zeros)["y"]
    columns = casadi.vertcat(*(symbols[name] for name in INPUTS))
    slopes = casadi.Function("J", [symbols[n] for n in INPUTS], [casadi.jacobian(value, columns)])
    assert stands_for(np.array(slopes(x, k)), np.array(wanted))


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("option", ["float32", "float64", "constant_time"])
def test_generated_c_and_its_status(option: str, tmp_path: Path) -> None:
    """All formulas in one model; the bit is set where a slope is infinite and nowhere else."""
    compiler = require_tool("gcc", install="apt install gcc")
    inputs = ", ".join(f"x{i}: {{}}, k{i}: {{}}" for i in range(len(CASES)))
    outputs = ", ".join(
        f'y{i}: "{_renamed(formula, i)}"' for i, (formula, *_) in enumerate(CASES.values())
    )
    program = compiled(f"""
        inputs: {{{inputs}}}
        dims: {{row: 2, column: 2}}
        parameters: {{{ZEROS}}}
        outputs: {{{outputs}}}
        """)
    program = to_step_form(prune_outputs(program, [o.name for o in program.outputs]))
    options = COptions(extras=("jacobian",), dtype="float64" if option == "float64" else "float32")
    if option == "constant_time":
        options = COptions(extras=("jacobian",), constant_time=True)
    step = built(program, tmp_path, options, [compiler])
    assert step.selftest() == 0
    step.init()
    given: dict[str, float] = {}
    wanted = np.zeros((len(CASES), 2 * len(CASES)))
    for i, (_, x, k, *slopes) in enumerate(CASES.values()):
        given |= {f"x{i}": x, f"k{i}": k}
        wanted[i, 2 * i : 2 * i + 2] = slopes
    found, status = step.linearize(given)
    assert agrees(found["D"], wanted)
    assert status == StatusBit.SLOPE_NOT_FINITE
    fine = dict.fromkeys(given, 0.25)
    found, status = step.linearize(fine)
    assert np.isfinite(found["D"]).all()
    assert status == 0


def _renamed(formula: str, number: int) -> str:
    words = {"x": f"x{number}", "k": f"k{number}"}
    return re.sub(r"\b[xk]\b", lambda found: words[found.group()], formula)

"""Each pass: its text in tests/passes/<pass>.txt, and the same numbers before and after."""

from __future__ import annotations

import ast
from collections.abc import Callable
from pathlib import Path
from typing import TypeGuard

import numpy as np
import pytest

from compiler.interpreter.interpreter import Interpreter, physical_weights
from compiler.ir.builder import GraphBuilder
from compiler.ir.nodes import extents
from compiler.ir.ops import Constant, ReadSignal, Relation, Select
from compiler.ir.program import Graph, Output, Program, Role, Signal
from compiler.ir.text import program_text
from compiler.ir.types import Axis, Type
from compiler.ir.verifier import verify
from compiler.passes import PASSES, run_passes
from compiler.passes.close_loop import close_loop
from compiler.passes.draw_dropout import draw_dropout
from compiler.passes.expand_functions import expand_functions
from compiler.passes.guard_derivatives import guard_infinite_slopes, guard_untaken
from compiler.passes.inline_parameters import inline_parameters
from compiler.passes.limit_expected import limit_expected
from compiler.passes.prune_zero_slices import drop_zero_numbers, prune_zero_slices
from compiler.passes.retime import retime
from compiler.passes.settle_zeros import settle_zeros
from compiler.passes.simplify import (
    LARGEST_FOLDED,
    drop_unused,
    fold_constants,
    prune_outputs,
    share_common,
)
from compiler.passes.smooth_kinks import smooth_kinks
from compiler.passes.to_step_form import to_step_form
from tests.golden import assert_golden
from tests.pass_programs import PASS_PROGRAMS
from tests.programs import SAMPLES

ROOT = Path(__file__).parent.parent.parent
FOLDER = ROOT / "tests" / "passes"

NATIVE = frozenset({"sin", "cos", "exp", "log", "sqrt", "tanh", "abs"})
# pass -> programs that its text shows, with what makes the input of the pass and the pass
CASES: dict[str, list[tuple[str, Callable[[], Program], Callable[[Program], Program]]]] = {
    "close_loop": [
        (
            name,
            lambda name=name: SAMPLES[name]().program,
            lambda program, name=name: close_loop(program, SAMPLES[name]().closed),
        )
        for name in ("fir_closed_loop", "preview_driver")
    ],
    "to_step_form": [
        (name, lambda name=name: SAMPLES[name]().program, to_step_form)
        for name in ("fuzzy_local_models", "preview_driver", "late_sensor")
    ],
    "retime": [
        (name, PASS_PROGRAMS[name], lambda p: retime(p, fixed_parameters=True))
        for name in ("mapped_windows",)
    ],
    "draw_dropout": [
        ("dropouts", PASS_PROGRAMS["dropouts"], lambda p: draw_dropout(p, {"frozen"}).program)
    ],
    "inline_parameters": [
        (
            "local_models",
            PASS_PROGRAMS["local_models"],
            lambda p: inline_parameters(p, {}),
        )
    ],
    "settle_zeros": [("local_models", PASS_PROGRAMS["local_models"], settle_zeros)],
    "fold_constants": [("numbers", PASS_PROGRAMS["numbers"], fold_constants)],
    "share_common": [(name, PASS_PROGRAMS[name], share_common) for name in ("twins", "named")],
    "drop_unused": [("leftovers", PASS_PROGRAMS["leftovers"], drop_unused)],
    "prune_outputs": [
        ("leftovers", PASS_PROGRAMS["leftovers"], lambda p: prune_outputs(p, ["kept"])),
        (
            "preview_driver",
            lambda: SAMPLES["preview_driver"]().program,
            lambda p: prune_outputs(p, ["command"]),
        ),
    ],
    "prune_zero_slices": [
        (
            "units_of_0",
            PASS_PROGRAMS["units_of_0"],
            lambda p: prune_zero_slices(p, physical_weights(p, {}), ["taps", "out"]).program,
        )
    ],
    "drop_zero_numbers": [
        ("single_numbers", PASS_PROGRAMS["single_numbers"], lambda p: drop_zero_numbers(p, ["off"]))
    ],
    "expand_functions": [
        ("functions", PASS_PROGRAMS["functions"], lambda p: expand_functions(p, NATIVE))
    ],
    "limit_expected": [("expectations", PASS_PROGRAMS["expectations"], limit_expected)],
    "guard_infinite_slopes": [
        ("steep", PASS_PROGRAMS["steep"], guard_infinite_slopes),
        ("branches", PASS_PROGRAMS["branches"], guard_infinite_slopes),
    ],
    "smooth_kinks": [("kinks", PASS_PROGRAMS["kinks"], smooth_kinks)],
    "guard_untaken": [("branches", PASS_PROGRAMS["branches"], guard_untaken)],
}


@pytest.mark.parametrize("name", CASES)
def test_text_of_the_pass(name: str, accept: bool) -> None:
    parts: list[str] = []
    for title, make, run in CASES[name]:
        program = make()
        verify(program)
        after = run(program)
        verify(after)
        parts.append(f"==== {title}, before\n{program_text(program)}")
        parts.append(f"==== {title}, after {name}\n{program_text(after)}")
    assert_golden(FOLDER / f"{name}.txt", "\n".join(parts), accept)


def test_every_pass_has_its_text() -> None:
    files = (ROOT / "compiler" / "passes").glob("[a-z]*.py")
    functions = (step for path in files for step in ast.parse(path.read_text("utf-8")).body)
    assert {step.name for step in functions if _is_pass(step)} == set(CASES), (
        "write a case of the pass in CASES of tests/compiler/test_passes.py"
    )
    assert {run.__name__ for run in PASSES} <= set(CASES)


def _is_pass(step: ast.stmt) -> TypeGuard[ast.FunctionDef]:
    """A function of a program that does not return what it finds, by node."""
    return (
        isinstance(step, ast.FunctionDef)
        and not step.name.startswith("_")
        and ast.unparse(step.args).startswith("program: Program")
        and step.returns is not None
        and not ast.unparse(step.returns).startswith("dict[NodeId")
    )


FORMS: dict[str, Callable[[Program], Program]] = {
    "step form": to_step_form,
    "all passes": run_passes,
    "step form of all passes": lambda program: to_step_form(run_passes(program)),
    "all passes on the step form": lambda program: run_passes(to_step_form(program)),
    "step form twice": lambda program: to_step_form(to_step_form(program)),
}


@pytest.mark.parametrize("closed", [False, True], ids=["open", "closed"])
@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("name", SAMPLES)
def test_passes_keep_every_bit(name: str, form: str, closed: bool) -> None:
    sample = SAMPLES[name]()
    program = close_loop(sample.program, sample.closed) if closed else sample.program
    changed = FORMS[form](program)
    verify(changed)
    log, starts = sample.log(100, 8), np.array([4, 30, 41])
    for dtype in (np.float64, np.float32):
        before = Interpreter(program, dtype=dtype).rollout(log, starts, 50)
        after = Interpreter(changed, dtype=dtype).rollout(log, starts, 50)
        for output, values in before.outputs.items():
            assert np.array_equal(values, after.outputs[output]), output


@pytest.mark.parametrize("name", SAMPLES)
def test_step_form_reads_each_input_once(name: str) -> None:
    sample = SAMPLES[name]()
    program = to_step_form(sample.program)
    reads = [node.op.signal for _, node in program.step if isinstance(node.op, ReadSignal)]
    assert len(reads) == len(set(reads))
    before, after = (extents(p.step, log=False) for p in (sample.program, program))
    for signal, extent in after.items():
        newest = min(before[signal].last, 0)
        assert (extent.first, extent.last) == (newest, max(before[signal].last, newest))


def test_step_form_is_reached_once_and_for_all() -> None:
    for make in SAMPLES.values():
        program = to_step_form(make().program)
        assert to_step_form(program) == program


def test_closing_twice_changes_nothing_more() -> None:
    sample = SAMPLES["preview_driver"]()
    program = close_loop(sample.program, sample.closed)
    assert close_loop(program, sample.closed) == program
    assert close_loop(sample.program, ()) == sample.program
    assert program.signal("u").role is Role.TARGET


def test_folding_keeps_what_is_not_finite_or_too_large() -> None:
    b = GraphBuilder()
    zero = b.constant(0.0)
    wide = Axis("k", LARGEST_FOLDED + 1)
    many = b.add(b.constant([1.0] * wide.size, (wide,)), b.constant(1.0))
    inverse = b.divide(b.constant(1.0), zero)
    outputs = (Output("many", many), Output("inverse", inverse))
    program = Program("kept", None, (), (), (), b.graph(), Graph(), outputs)
    folded = fold_constants(program)
    assert not any(isinstance(folded.step[out.node].op, Constant) for out in folded.outputs)


def test_a_choice_that_differs_by_element_is_folded_to_neither_operand() -> None:
    b, k = GraphBuilder(), Axis("k", 3)
    x, y = (b.signal(name, 0, 0, Type((k,))) for name in ("x", "y"))
    condition = b.compare(Relation.LESS, b.constant([1.0, 2.0, 3.0], (k,)), b.constant(2.5))
    outputs = (
        Output("mixed", b.select(condition, x, y)),
        Output("all", b.select(b.compare(Relation.LESS, b.constant(1.0), b.constant(2.5)), x, y)),
        Output("none", b.select(b.compare(Relation.LESS, b.constant(3.0), b.constant(2.5)), x, y)),
    )
    signals = tuple(Signal(name, Role.INPUT, axes=(k,)) for name in ("x", "y"))
    program = run_passes(Program("choices", None, signals, (), (), b.graph(), Graph(), outputs))
    log = {"x": np.array([[1.0, 2.0, 3.0]]), "y": np.array([[-1.0, -2.0, -3.0]])}
    found = Interpreter(program).step(log, 0, {}).outputs
    assert found["mixed"].tolist() == [[1.0, 2.0, -3.0]]
    assert found["all"].tolist() == [[1.0, 2.0, 3.0]]
    assert found["none"].tolist() == [[-1.0, -2.0, -3.0]]
    assert sum(isinstance(node.op, Select) for _, node in program.step) == 1


def test_zeros_of_both_signs_stay_apart() -> None:
    b = GraphBuilder()
    x = b.signal("x", 0, 0, Type())
    outputs = tuple(
        Output(name, b.divide(x, b.constant(zero))) for name, zero in (("p", 0.0), ("n", -0.0))
    )
    signals = (Signal("x", Role.INPUT),)
    program = run_passes(Program("zeros", None, signals, (), (), b.graph(), Graph(), outputs))
    found = Interpreter(program).step({"x": np.ones(1)}, 0, {}).outputs
    assert (found["p"][0], found["n"][0]) == (np.inf, -np.inf)


def test_pruning_to_an_unknown_output_is_refused() -> None:
    with pytest.raises(KeyError, match="nothing"):
        prune_outputs(SAMPLES["late_sensor"]().program, ["nothing"])


def test_expansion_without_a_definition_is_refused() -> None:
    with pytest.raises(ValueError, match="`exp` has no definition"):
        expand_functions(SAMPLES["late_sensor"]().program, frozenset())


def test_long_chains_need_no_deep_stack() -> None:
    b = GraphBuilder()
    value = b.signal("x", -1, -1, Type())
    for _ in range(10_000):
        value = b.add(value, b.constant(1.0))
    outputs = (Output("y", value, None),)
    signals = (Signal("x", Role.INPUT),)
    program = Program("chain", None, signals, (), (), b.graph(), Graph(), outputs)
    program = to_step_form(close_loop(run_passes(program), ()))
    found = Interpreter(program).step({"x": np.zeros(2)}, 1, {})
    assert found.outputs["y"][0] == 10_000

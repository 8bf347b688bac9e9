"""What leaves the loop over time: sums over logs, gradients of weights, adjoints of filters."""

from __future__ import annotations

from backends.native.loop_splitting import Phases, late_adjoints, split_loops
from compiler.differentiation.training_step import TrainingStep, training_step
from compiler.ir.ops import Contract
from compiler.passes.close_loop import close_loop
from tests.language.compiled import compiled
from tests.native.test_kernel import FILTERED_JOINTS, FIR, LEARNED_START, VEHICLE


def divided(text: str, closed: str) -> tuple[TrainingStep, Phases]:
    step = training_step(close_loop(compiled(text), (closed,)))
    return step, split_loops(step)


def test_filters_of_inputs_run_ahead_and_filters_of_the_loop_do_not() -> None:
    step, found = divided(FIR, "x")
    (ahead,) = found.ahead
    node = step.program.step[ahead]
    assert isinstance(node.op, Contract)
    assert node.label is None
    read = [step.program.step[arg].op for arg in node.args]
    assert "F" in str(read)
    assert "x" not in str(read)


def test_gradients_of_taps_are_summed_after_the_loop() -> None:
    _, found = divided(VEHICLE, "v")
    assert {late.parameter for late in found.late} == {"lm.weight"}
    assert {name for name, _ in found.direct} == {"c1"}  # a scalar: nothing to share


def test_what_a_gradient_is_made_of_is_kept_once() -> None:
    step, found = divided(FIR, "x")
    assert {late.parameter for late in found.late} == {"h_x.weight", "h_F.weight"}
    (cut,) = found.cuts  # the adjoint of the output serves both filters
    assert step.reverse_step.graph[cut].type.shape == ()


def test_dear_values_are_kept_and_cheap_ones_computed_again() -> None:
    step, found = divided(VEHICLE, "v")
    kept = [step.program.step[node] for node in found.kept]
    assert [type(node.op).__name__ for node in kept] == ["Select", "Apply"]  # sets, exp(−v²)


def test_adjoints_of_filtered_buffers_are_collected() -> None:
    step, _ = divided(FILTERED_JOINTS, "q")
    (adjoint,) = late_adjoints(step)  # h_q(sin(q)) filters no buffer of its own
    assert adjoint.state == "q.tape"
    assert step.reverse_step.graph[adjoint.source].type.axis_names == ("joint",)


def test_a_start_that_learns_keeps_the_adjoints_of_all_samples() -> None:
    step = training_step(compiled(LEARNED_START))
    assert step.reverse_start.gradients.parameters
    assert late_adjoints(step) == ()

"""Rules R4 and R9: losses of rollouts in torch are those of the interpreter, and of hand counts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from backends.torch_module.module import build_module
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Loss, Measure, Output, Program, Role, Signal
from compiler.ir.types import Type
from compiler.passes.close_loop import close_loop
from msnn.data.dataset import BoolArray, FloatArray
from msnn.data.rollout_rows import Runs, reach, rollouts
from msnn.simulation.rollout import loss_sums
from msnn.training.engines.torch.torch_losses import batch_losses, scoring
from tests.programs import SAMPLES
from tests.training.cases import compiled

# Sums in another order, all in float64.
TOLERANCE = 1e-12
RUNS = Runs(np.array([5, 8, 6]), np.array([4, 9, 4]), 0, 0)


def both(
    program: Program,
    log: dict[str, FloatArray],
    runs: Runs,
    skip: int = 0,
    scored: dict[str, BoolArray] | None = None,
) -> dict[str, tuple[float, float]]:
    """Losses and counts of the torch engine, after comparing them with the interpreter's."""
    expected = loss_sums(Interpreter(program), log, runs, skip, scored)
    model = build_module(program)
    found = batch_losses(model, scoring(model, log, skip, scored), runs)
    result: dict[str, tuple[float, float]] = {}
    for loss in program.losses:
        value = found[loss.name].value(loss.measure).item()
        assert found[loss.name].count == expected[loss.name].count
        assert value == pytest.approx(expected[loss.name].value(loss.measure), rel=TOLERANCE)
        result[loss.name] = value, found[loss.name].count
    return result


@pytest.mark.parametrize("name", [name for name in SAMPLES if SAMPLES[name]().program.losses])
@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("skip", [0, 3])
def test_rollouts_of_unlike_lengths_agree(name: str, closed: bool, skip: int) -> None:
    """docs/language.md, Rollouts (R4)."""
    sample = SAMPLES[name]()
    program = close_loop(sample.program, sample.closed) if closed else sample.program
    both(program, sample.log(40, 5), RUNS, skip)


def test_a_closed_rollout_by_hand() -> None:
    """docs/language.md, Rollouts (R4)."""
    program, _ = compiled(
        "msnn: 1\nname: p\nsample_time: 1 s\ninputs: {x: 1}\nparameters: {a: 0.5}\n"
        'outputs: {y: {expr: "a*x", predicts: "x[t+1]"}}\n'
    )
    log = {"x": np.array([8.0, 1.0, 1.0, 1.0])}
    runs = Runs(np.array([0]), np.array([3]), 0, 4)
    # open: predictions 4, .5, .5; closed: 4, 2, 1; targets always 1 from the log
    assert both(program, log, runs)["y"] == (pytest.approx((9 + 0.25 + 0.25) / 3), 3)
    assert both(close_loop(program, ["x"]), log, runs)["y"] == (pytest.approx((9 + 1 + 0) / 3), 3)


def test_a_missing_target_is_not_scored() -> None:
    """docs/language.md, Losses (R9)."""
    sample = SAMPLES["spring_damper_rk4"]()
    log = sample.log(40, 5)
    whole = both(sample.program, log, RUNS)["fit"][1]
    log["x.meas"][9:12] = np.nan
    # rows 9 … 11 are targets of t = 8 … 10: one of run 0, all of run 1's first three, two of run 2
    assert both(sample.program, log, RUNS)["fit"][1] == whole - (1 + 3 + 2)


def test_where_nothing_is_scored_the_loss_is_zero() -> None:
    """docs/language.md, Losses (R9)."""
    sample = SAMPLES["spring_damper_rk4"]()
    log = sample.log(40, 5)
    log["x.meas"][6:] = np.nan
    assert both(sample.program, log, RUNS)["fit"] == (0.0, 0)


def test_skip_leaves_out_the_first_evaluations() -> None:
    """docs/language.md, Losses (R9)."""
    sample = SAMPLES["joint_arm"]()
    found = both(sample.program, sample.log(40, 5), RUNS, skip=3)
    assert found["q_next"][1] == (1 + 6 + 1) * 3  # three joints


def test_of_a_whole_record_only_rows_of_the_set_count() -> None:
    """docs/language.md, Data (R10)."""
    sample = SAMPLES["fir_closed_loop"]()
    log = sample.log(40, 5)
    program = close_loop(sample.program, ("x",))
    rows = np.zeros(40, dtype=np.bool_)
    rows[7:9] = True
    assert both(program, log, RUNS, scored={"x_next": rows})["x_next"][1] == 2 + 1 + 2


@pytest.mark.parametrize(
    ("measure", "delta"),
    [*((measure, 1.0) for measure in Measure), (Measure.HUBER, 0.1), (Measure.HUBER, 1.5)],
)
def test_each_measure_by_hand(measure: Measure, delta: float) -> None:
    """docs/language.md, Losses (R9)."""
    b = GraphBuilder()
    value, target = b.signal("p", 0, 0, Type()), b.log("q", 0, 0, Type())
    alone = measure is Measure.MEAN
    loss = Loss("loss", measure, value, None if alone else target, delta=delta)
    program = Program(
        "losses", None, (Signal("p", Role.INPUT), Signal("q", Role.TARGET)), (), (),
        b.graph(), GraphBuilder().graph(), (Output("p", value),), (loss,),
    )  # fmt: skip
    log = {"p": np.array([1.0, 2.0, 5.0]), "q": np.array([1.5, 0.0, 5.0])}
    expected = {
        Measure.MSE: (0.25 + 4) / 3,
        Measure.RMSE: np.sqrt((0.25 + 4) / 3),
        Measure.MAE: 2.5 / 3,
        # errors of 0.5, 2, 0
        Measure.HUBER: {
            1.0: (0.125 + 1.5) / 3,
            0.1: (0.1 * (0.5 - 0.05) + 0.1 * (2 - 0.05)) / 3,
            1.5: (0.125 + 1.5 * (2 - 0.75)) / 3,
        }[delta],
        Measure.MEAN: 8 / 3,
    }[measure]
    runs = rollouts(np.array([[0, 3]]), reach(program), 1, 1)
    assert both(program, log, runs)["loss"] == (pytest.approx(expected, rel=1e-15), 3)


def test_the_root_of_a_perfect_fit_has_slope_zero() -> None:
    """docs/language.md, Losses (R9)."""
    sample = SAMPLES["preview_driver"]()
    program = sample.program
    log = sample.log(40, 5)
    log["road"][:] = 0.0
    log["u"][:] = 0.0
    model = build_module(program)
    data = scoring(model, log, 0, None)
    batch_losses(model, data, RUNS)["command"].value(Measure.RMSE).backward()
    for parameter in model.parameters():
        assert parameter.grad is None or torch.all(torch.isfinite(parameter.grad))


def test_losses_are_differentiable_through_the_whole_rollout() -> None:
    sample = SAMPLES["fir_closed_loop"]()
    program = close_loop(sample.program, ("x",))
    log = sample.log(40, 5)
    model = build_module(program)
    data = scoring(model, log, 0, None)
    batch_losses(model, data, RUNS)["x_next"].value(Measure.MSE).backward()
    gradient = model.raw("h.weight").grad
    assert gradient is not None
    step = 1e-6
    for index in range(5):
        values: list[float] = []
        for sign in (1, -1):
            initial = np.array(program.parameter("h.weight").initial)
            initial[index] += sign * step
            weights = {"h.weight": initial}
            sums = loss_sums(Interpreter(program, weights), log, RUNS)
            values.append(sums["x_next"].value(Measure.MSE))
        central = (values[0] - values[1]) / (2 * step)
        # a central difference of step h errs by h² f‴/6 and by rounding, ε/h ≈ 1e-10
        assert gradient[index].item() == pytest.approx(central, rel=1e-6)


def test_targets_are_read_from_the_log_though_the_loop_is_closed() -> None:
    sample = SAMPLES["fir_closed_loop"]()
    program = close_loop(sample.program, ("x",))
    log = sample.log(40, 5)
    before = both(program, log, RUNS)["x_next"][0]
    log["x"][9:] += 1.0  # after the taps of the first run: only targets change
    shifted = replace(RUNS, t0=RUNS.t0[:1], steps=RUNS.steps[:1])
    assert both(program, log, shifted)["x_next"][0] != before

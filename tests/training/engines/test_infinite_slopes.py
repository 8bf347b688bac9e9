"""What training does with infinite slopes: they have no share in steps, alike in both engines."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from backends.gauss_newton_products import Products
from compiler.differentiation.sensitivities import sensitivities
from compiler.differentiation.sums_of_squares import with_compared_squares
from compiler.differentiation.training_step import training_step
from msnn.data.dataset import FloatArray
from msnn.data.rollout_rows import Runs
from msnn.model.load import load_model
from msnn.training.engines.engine import Engine, EngineState
from msnn.training.engines.native.native_squares import NativeSquares
from msnn.training.engines.open_engine import open_engine
from msnn.training.engines.torch.torch_squares import TorchSquares
from msnn.training.plans.epochs import NO_REDUCTIONS
from msnn.training.plans.stage_data import StageData
from msnn.training.plans.stage_plan import StagePlan, plan_stages
from msnn.training.records.checkpoint import (
    Checkpoint,
    TrainingPosition,
    read_checkpoint,
    write_checkpoint,
)
from msnn.training.records.learned.standard_errors import StandardErrors, standard_errors
from msnn.training.records.progress import Silent
from msnn.training.records.training_options import TrainingOptions
from msnn.training.train import train
from msnn.training.training_result import TrainingDivergedError, TrainingResult
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings
from tests.conditions import require_tool
from tests.examples.gallery import GALLERY, NAMES
from tests.training.cases import compiled, dataset

ENGINES = ("native", "torch")
TRUE, FIRST = 0.75, 1.0
"""Of k: data are made with the one, training begins with the other."""

ROOT = """
msnn: 1
name: root
inputs: {u: {}}
targets: {z: {}}
parameters: {k: {init: 1}, m: {init: 1}}
STATES
outputs: {y: {expr: "EXPR", predicts: "z[t]"}}
train: [STAGE]
"""
HELD = "m * sqrt(max(u - k, 0))"
"""Where u is k it is infinitely steep in k."""

CARRIED = 'states: {s: {next: "0.5 * s + sqrt(max(u - k, 0))", init: 0}}'
"""What is infinite in one step is so in all that follow."""


def text(stage: str, expr: str = HELD, states: str = "") -> str:
    found = ROOT.replace("STAGE", stage).replace("EXPR", expr)
    return found.replace("STATES", states) if states else found.replace("STATES\n", "")


def measured(at_first: int = 1, rows: int = 40) -> dict[str, FloatArray]:
    """Some rows at which u is where k begins, and others above."""
    u = np.concatenate((np.full(at_first, FIRST), np.linspace(1.5, 4.0, rows - at_first)))
    return {"u": u, "z": np.sqrt(np.maximum(u - TRUE, 0.0))}


class Warned(Silent):
    """Keeps the codes of warnings."""

    def __init__(self) -> None:
        self.codes: list[str] = []

    def warned(self, diagnostic: Diagnostic) -> None:
        self.codes.append(diagnostic.code)


@pytest.fixture(params=ENGINES)
def engine(request: pytest.FixtureRequest) -> str:
    if request.param == "native":
        require_tool("gcc", install="apt install gcc")
    return request.param


def run(
    stage: str, series: dict[str, FloatArray], progress: Silent | None = None
) -> TrainingResult:
    program, spec = compiled(text(stage))
    data = dataset(series, train=[len(series["u"])])
    return train(program, data, spec.train, TrainingOptions(runs=None), progress)


def planned(stage: str, expr: str = HELD, states: str = "") -> StagePlan:
    program, spec = compiled(text(stage, expr, states))
    (plan,) = plan_stages(program, spec.train, Findings())
    return plan


# ---- second order


LM = "{epochs: 30, engine: ENGINE, optimizer: {levenberg_marquardt: {}}}"


SMALL = 2.0**-83
"""A power of 2, so that k / SMALL is exactly what k is in the unit without it."""


def both(expr: str, states: str, series: dict[str, FloatArray], runs: Runs) -> list[Products]:
    require_tool("gcc", install="apt install gcc")
    plan = planned(LM.replace("ENGINE", "auto"), expr, states)
    found: list[Products] = []
    for squares in (NativeSquares, TorchSquares):
        made = squares(plan, series, None, None)
        first = {"k": np.array(FIRST), "m": np.array(1.0)}
        made.check(runs, first)
        (one,) = made.products(runs, first).values()
        found.append(one)
    return found


def runs_of(t0: list[int], steps: int) -> Runs:
    return Runs(np.array(t0), np.full(len(t0), steps), 0, 10**6)


def assert_alike(one: Products, other: Products) -> None:
    np.testing.assert_allclose(one.curvature, other.curvature, rtol=1e-12)
    np.testing.assert_allclose(one.slope, other.slope, rtol=1e-12)
    assert one.squares == pytest.approx(other.squares, rel=1e-12)
    assert one.cost == pytest.approx(other.cost, rel=1e-12)
    assert (one.count, one.left_out) == (other.count, other.left_out)


def test_a_row_with_an_infinite_slope_has_no_share_in_the_normal_equations() -> None:
    series = measured(at_first=3)
    native, torch = both(HELD, "", series, runs_of([*range(40)], 1))
    assert_alike(native, torch)
    without, _ = both(HELD, "", series, runs_of([*range(3, 40)], 1))
    np.testing.assert_allclose(native.curvature, without.curvature, rtol=1e-12)
    np.testing.assert_allclose(native.slope, without.slope, rtol=1e-12)
    assert native.squares == pytest.approx(without.squares, rel=1e-12)
    assert native.cost == pytest.approx(without.cost + 3 * (FIRST - TRUE), rel=1e-12)
    assert (native.count, native.left_out) == (40, 3)


def test_what_a_state_carries_on_is_left_out_too() -> None:
    series = measured(at_first=1)
    series["u"][[0, 7]] = 2.0, FIRST
    native, torch = both("m * s", CARRIED, series, runs_of([0, 5, 20], 6))
    assert_alike(native, torch)
    # of the rollout from row 5 the steps after row 7, which y sees one step later
    assert native.left_out == 3
    assert np.isfinite(native.curvature).all()


def test_an_infinite_slope_times_0_is_0_and_stays_in() -> None:
    """Below k the slope of what the max holds is 0, however steep the root."""
    series = measured(at_first=0)
    series["u"][::2] = 0.5
    native, torch = both(HELD, "", series, runs_of([*range(40)], 1))
    assert_alike(native, torch)
    assert native.left_out == 0


def test_a_large_slope_in_a_number_of_small_scale_is_finite(engine: str) -> None:
    """A leak in m^3/s/Pa is tiny: what it does is as in any other unit."""
    small = text(LM.replace("ENGINE", engine), HELD.replace("k", f"k / {SMALL!r}")).replace(
        "k: {init: 1}", f"k: {{init: {SMALL!r}, scale: {SMALL!r}}}"
    )
    program, spec = compiled(small)
    (plan,) = plan_stages(program, spec.train, Findings())
    squares = NativeSquares if engine == "native" else TorchSquares
    made = squares(plan, measured(at_first=3), None, None)
    first = {"k": np.array(FIRST * SMALL), "m": np.array(1.0)}
    (found,) = made.products(runs_of([*range(40)], 1), first).values()
    assert (found.count, found.left_out) == (40, 3)
    plain, _ = both(HELD, "", measured(at_first=3), runs_of([*range(40)], 1))
    by_scale = found.slope * [SMALL if name == "k" else 1.0 for name in plan.trained]
    np.testing.assert_allclose(by_scale, plain.slope, rtol=1e-9)


def test_a_pole_that_saturates_has_slope_0() -> None:
    """The divisor is a signal, so that the dividend alone moves."""
    series = measured(at_first=0)
    series["u"][5] = 0.0
    native, torch = both("atan(k / u) + m", "", series, runs_of([*range(40)], 1))
    assert_alike(native, torch)
    assert native.left_out == 0
    assert np.isfinite(native.curvature).all()


def test_training_goes_on_with_one_warning(engine: str) -> None:
    progress = Warned()
    result = run(LM.replace("ENGINE", engine), measured(at_first=2), progress)
    assert float(result.weights["k"]) == pytest.approx(TRUE, abs=1e-6)
    assert progress.codes == ["W0744"]


def test_where_nothing_is_left_training_ends(engine: str) -> None:
    with pytest.raises(TrainingDivergedError) as caught:
        run(LM.replace("ENGINE", engine), measured(at_first=40))
    said = caught.value.diagnostic
    assert said.code == "E0985"
    assert "its slope in `k` is not" in said.message


def test_standard_errors_are_those_of_the_other_rows() -> None:
    plan, weights = planned(LM.replace("ENGINE", "torch")), {"k": np.array(FIRST)}
    weights["m"] = np.array(1.1)
    found: list[StandardErrors] = []
    for at_first in (3, 0):
        series = measured(at_first=3)
        kept = {name: values[3 - at_first :] for name, values in series.items()}
        data = dataset(kept, train=[len(kept["u"])])
        found.append(standard_errors(plan, data, weights))
    one, other = found
    assert one.noise["y"] == pytest.approx(other.noise["y"], rel=1e-9)
    assert one.residuals == other.residuals
    for name, error in other.errors.items():
        assert float(one.errors[name]) == pytest.approx(float(error), rel=1e-9)


# ---- first order


FIRST_ORDER = "{epochs: 3, batch: 8, engine: ENGINE, dtype: DTYPE, optimizer: OPT}"
OPTIMIZERS = ("adam: {lr: 0.01}", "sgd: {lr: 0.001, momentum: 0.9}", "torch: RAdam")
BATCH = 8


def stage_of(engine: str, dtype: str = "float64", optimizer: str = OPTIMIZERS[0]) -> str:
    found = FIRST_ORDER.replace("ENGINE", engine).replace("DTYPE", dtype)
    return found.replace("OPT", f"{{{optimizer}}}")


def opened(engine: str, dtype: str, optimizer: str, series: dict[str, FloatArray]) -> Engine:
    plan = planned(stage_of(engine, dtype, optimizer))
    first = {"k": np.array(FIRST), "m": np.array(1.0)}
    every = runs_of([*range(len(series["u"]))], 1)
    data = StageData(
        train=every, train_rows=None, watched=every, watched_rows=None, watched_set="train"
    )
    return open_engine(plan, series, first, data).engine


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("optimizer", OPTIMIZERS)
def test_a_batch_with_an_infinite_slope_takes_no_step(
    engine: str, optimizer: str, dtype: str
) -> None:
    series = measured(at_first=3)
    one, other = (opened(engine, dtype, optimizer, series) for _ in range(2))
    found = one.train_batches(runs_of([*range(40)], 1), BATCH)
    assert (one.left_out, one.has_left_out) == (1, True)
    other.train_batches(runs_of([*range(8, 40)], 1), BATCH)
    assert (other.left_out, other.has_left_out) == (0, False)
    assert one.weights() == other.weights()
    assert float(one.weights()["k"]) != FIRST
    assert found["y"].count == 40


@pytest.mark.parametrize("optimizer", OPTIMIZERS)
def test_both_engines_take_the_same_steps(optimizer: str) -> None:
    require_tool("gcc", install="apt install gcc")
    series = measured(at_first=3)
    native, torch = (opened(name, "float64", optimizer, series) for name in ENGINES)
    for made in (native, torch):
        made.train_batches(runs_of([*range(40)], 1), BATCH)
    for name, weight in torch.weights().items():
        assert float(native.weights()[name]) == pytest.approx(float(weight), rel=1e-9)


@pytest.mark.parametrize(
    "state",
    ['{next: "k * u", init: 1}', '{next: "0.5 * s", init: "k * u"}'],
    ids=["from a step", "from the start"],
)
def test_an_infinite_adjoint_of_a_state_times_0_is_0(state: str, engine: str) -> None:
    """Where u is 0 the root is infinitely steep in the state, and the state does not feel k."""
    stage = (
        f"{{epochs: 3, batch: 4, rollout: 3, engine: {engine}, optimizer: {{sgd: {{lr: 0.1}}}}}}"
    )
    program, spec = compiled(text(stage, "m * sqrt(s)", f"states: {{s: {state}}}"))
    u = np.tile([0.0, 0.5, 1.0, 2.0], 6)
    heard = Warned()
    data = dataset({"u": u, "z": np.full(len(u), 0.7)}, train=[len(u)])
    found = train(program, data, spec.train, TrainingOptions(runs=None), heard)
    assert "W0744" not in heard.codes
    assert found.stages[0].best_epoch > 0
    assert found.weights["k"] != 1


def test_first_order_goes_on_with_one_warning(engine: str) -> None:
    progress = Warned()
    stage = stage_of(engine).replace("batch: 8", "batch: 2")
    result = run(stage, measured(at_first=20), progress)
    assert float(result.weights["k"]) < FIRST
    assert progress.codes == ["W0744"]


@pytest.mark.parametrize("optimizer", [*OPTIMIZERS, "lbfgs: {}"])
def test_where_no_batch_is_left_training_ends(engine: str, optimizer: str) -> None:
    """Adam's memory of a slope of 1e30 would else hold a parameter where it is, without a word."""
    with pytest.raises(TrainingDivergedError) as caught:
        run(stage_of(engine, "float32", optimizer), measured(at_first=40))
    said = caught.value.diagnostic
    assert said.code == "E0985"
    assert "its slope in `k` is not" in said.message


@pytest.mark.parametrize("optimizer", [*OPTIMIZERS, "lbfgs: {}"])
@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_at_rate_0_nothing_moves_and_no_slope_counts(
    engine: str, optimizer: str, dtype: str
) -> None:
    """A schedule ends there: with 1e-60 in float32 too. What follows is as if it had not been."""
    made, other = (opened(engine, dtype, optimizer, measured(40, 80)) for _ in range(2))
    before = made.weights()
    for epoch, rate in enumerate([0.0, 1e-60 if dtype == "float32" else 0.0]):
        made.begin_epoch(epoch, rate)
        sums = made.train_batches(runs_of([*range(40)], 1), BATCH)
        assert sums["y"].count == 40
        assert (made.left_out, made.has_left_out) == (0, False)
        assert made.weights() == before
    other.restore(made.state())
    for one in (made, other):
        one.begin_epoch(2, 1.0)
        one.train_batches(runs_of([*range(40, 80)], 1), BATCH)
    fresh = opened(engine, dtype, optimizer, measured(40, 80))
    fresh.train_batches(runs_of([*range(40, 80)], 1), BATCH)
    assert made.weights() == other.weights() == fresh.weights() != before


@pytest.mark.parametrize("optimizer", OPTIMIZERS)
def test_a_number_of_rate_0_is_held_however_steep(engine: str, optimizer: str) -> None:
    """Its slope is no part of the length that `clip` cuts either."""
    progress = Warned()
    held = f"{{clip: 0.01, lr: {{k: 0}}, {stage_of(engine, 'float64', optimizer)[1:]}"
    result = run(held, measured(at_first=10), progress)
    assert float(result.weights["k"]) == FIRST
    assert float(result.weights["m"]) != 1.0
    # a rate this small moves m by less than 1 % in some optimisers: W0937
    assert not {*progress.codes} - {"W0937"}
    frozen = run(held.replace("lr: {k: 0}", "freeze: [k]"), measured(at_first=10))
    assert float(result.weights["m"]) == pytest.approx(float(frozen.weights["m"]), rel=1e-14)


def test_batches_without_a_step_are_counted_over_an_interruption(tmp_path: Path) -> None:
    """Else an epoch in which no batch was left would end the one training and not the other."""
    place = TrainingPosition(
        epoch=1,
        batch=2,
        sums={},
        left_out=2,
        best_value=1.0,
        best_epoch=0,
        best={},
        engine=EngineState({}, {}),
        reductions=NO_REDUCTIONS,
        spread=0.0,
        found_rate=1.0,
        seconds=0.0,
    )
    write_checkpoint(tmp_path / "checkpoint", Checkpoint(ended=(), begin={}, place=place))
    assert read_checkpoint(tmp_path / "checkpoint").place == place


# ---- who pays


STEEP = {"heater", "two_tanks", "tyre"}
"""Those with a root or a power of what can be 0; where a quotient is, so is the loss."""


@pytest.mark.parametrize("name", NAMES)
def test_only_models_with_infinite_slopes_look_for_them(name: str) -> None:
    model = load_model(GALLERY / f"{name}.msnn.yaml")
    (plan,) = plan_stages(model.program, model.spec.train, Findings())
    program = with_compared_squares(plan.rollout.program)
    found = sensitivities(program, plan.trained)
    looks = any(one.left_out is not None for one in found.residuals)
    assert (training_step(plan.program).has_infinite_slopes, looks) == (name in STEEP,) * 2

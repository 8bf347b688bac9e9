"""`init: {fit: …}`: the first evaluations of each run decide where it starts (R7)."""

from __future__ import annotations

import itertools
import os
import signal
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from compiler.differentiation.estimated_starts import evaluations_that_decide
from compiler.program_file.file import program_from_json, program_to_json
from msnn.data.dataset import FloatArray
from msnn.data.rollout_rows import Runs
from msnn.simulation.simulate import simulate, simulation_program
from msnn.simulation.start_fit import FoundStarts, StartFit
from msnn.training.plans.stage_plan import plan_stages
from msnn.training.records.learned.standard_errors import standard_errors
from msnn.training.records.progress import EpochEnd, Silent
from msnn.training.records.run_record import stage_record
from msnn.training.records.training_options import TrainingOptions
from msnn.training.train import train
from msnn.training.training_result import TrainingInterruptedError, TrainingResult
from msnn.validation.validate import validate
from spec_schema.diagnostics.diagnostic import Findings, SpecError
from tests.conditions import require_tool
from tests.training.cases import compiled, dataset
from tests.training.engines.engine_losses import ENGINES, losses
from tests.training.oscillator import (
    FITTED,
    FROM_REST,
    NOISE,
    TRUE,
    best_start,
    positions,
    records,
)

OVER = 40
NO_FOLDER = TrainingOptions(runs=None)


def run_errors(u: FloatArray, q: FloatArray, k: float = 5.0, d: float = 0.2) -> FloatArray:
    """y − q of the evaluations after those that decide the start."""
    start = best_start(k, d, u[:OVER], q[:OVER])
    return (positions(k, d, start, u) - q)[OVER:]


# ---- validation and simulation


@pytest.mark.parametrize("missing", [False, True])
def test_validation_starts_each_run_by_least_squares(missing: bool) -> None:
    series = records(2, 200, seed=3)
    if missing:
        series["q"][[4, 9, 30, 210]] = np.nan
    checks = "validate:\n  - {of: y, rollout: record}\n  - {of: y, rollout: {horizon: 100}}\n"
    program, spec = compiled(FITTED + checks)
    report = validate(program, dataset(series, test=[200, 200]), spec.checks, TRUE)
    for row, length in zip(report.rows, (200, 100), strict=True):
        spans = [slice(begin, begin + length) for begin in range(0, 400, length)]
        errors = np.concatenate([run_errors(series["u"][s], series["q"][s]) for s in spans])
        errors = errors[~np.isnan(errors)]
        assert row.scored == len(errors)
        assert row.value == pytest.approx(float(np.sqrt(np.mean(errors**2))), rel=1e-9)
    assert report.warnings == ()


def test_without_entries_whole_records_are_measured() -> None:
    series = records(2, 200, seed=3)
    program, _ = compiled(FITTED)
    (row,) = validate(program, dataset(series, test=[200, 200]), [], TRUE).rows
    errors = [run_errors(series["u"][s], series["q"][s]) for s in (slice(200), slice(200, 400))]
    assert (row.horizon, row.scored) == ("record", 320)
    assert row.value == pytest.approx(float(np.sqrt(np.mean(np.square(errors)))), rel=1e-9)


@pytest.mark.parametrize("over", [7, 40])
def test_a_simulation_starts_by_the_first_rows_of_its_record(over: int) -> None:
    """All states together by as many rows as one of them asks for."""
    series = records(2, 150, seed=5)
    program, _ = compiled(FITTED.replace("over: 40", f"over: {over}"))
    free = simulation_program(program)
    found = simulate(free, dataset(series, test=[150, 150]), TRUE)
    for run, rows in zip(found, (slice(150), slice(150, 300)), strict=True):
        u, q = series["u"][rows], series["q"][rows]
        start = best_start(5.0, 0.2, u[:OVER], q[:OVER])
        expected = positions(5.0, 0.2, start, u)
        assert run.outputs["y"] == pytest.approx(expected, rel=1e-9, abs=1e-12)
    assert found.warnings == ()


def test_a_record_shorter_than_what_decides_its_start_asks_no_other_record() -> None:
    """Its last evaluation compares with its last row, though 40 evaluations would decide."""
    model = """
msnn: 1
name: late
sample_time: 1 s
inputs: {u: 1}
targets: {q: 1}
states: {s: {next: "0.5 * s + u", init: {fit: {over: 40}}}}
outputs: {y: {expr: "0.5 * s + u", predicts: "q[t+1]"}}
"""
    random = np.random.default_rng(1)
    series = {"u": random.normal(size=24), "q": np.repeat([0.1, 1e6], 12)}
    free = simulation_program(compiled(model)[0])
    first, _ = simulate(free, dataset(series, test=[12, 12]))
    (alone,) = simulate(free, dataset(series, test=[12]))
    np.testing.assert_array_equal(first.outputs["y"], alone.outputs["y"])


def test_rollouts_reach_the_noise_where_a_start_at_rest_does_not() -> None:
    series = records(4, 200, seed=7)
    checks = "validate:\n  - {of: y, rollout: record}\n"
    values: list[float] = []
    for text in (FITTED, FROM_REST):
        program, spec = compiled(text + checks)
        (row,) = validate(program, dataset(series, test=[200] * 4), spec.checks, TRUE).rows
        values.append(row.value)
    fitted, from_rest = values
    # 320 of 640 values share a start: its error adds little to the noise
    assert fitted < 1.15 * NOISE
    assert from_rest > 4 * NOISE


def test_what_is_not_decided_stays_and_is_said() -> None:
    """A state that nothing measured feels: its start is anybody's guess."""
    state = "  w: {unit: m, next: 0.9 * w, init: {fit: {over: 40}}}\nintegrator:"
    text = FITTED.replace("integrator:", state).replace("outputs: {", "outputs: {z: w, ")
    program, spec = compiled(f"{text}validate:\n  - {{of: y, rollout: record}}\n")
    series = records(3, 200, seed=3)
    report = validate(program, dataset(series, test=[200] * 3), spec.checks, TRUE)
    (warning,) = report.warnings
    assert warning.code == "W0807"
    said = "do not decide where `w` starts, from row 0 of test0.csv and 2 other starts"
    assert said in warning.message
    assert report.rows[0].value < 1.15 * NOISE


FALLING = """
msnn: 1
name: falling
sample_time: 1 s
inputs: {u: 1}
targets: {z: 1}
states: {s: {next: "s", init: {fit: {over: 5}}}}
outputs: {y: {expr: "exp(-s) + 0 * u", predicts: z}}
validate:
  - {of: y, rollout: record}
"""


def test_a_search_that_does_not_end_is_said() -> None:
    """exp(-s) falls for ever: 20 steps of about 1 do not reach its least value."""
    program, spec = compiled(FALLING)
    data = dataset({"u": np.zeros(20), "z": np.zeros(20)}, test=[20])
    report = validate(program, data, spec.checks)
    assert [warning.code for warning in report.warnings] == ["W0808"]
    assert "`s` starts has not converged, from row 0 of test0.csv" in report.warnings[0].message


def test_a_program_file_keeps_what_decides_a_start() -> None:
    program, _ = compiled(FITTED)
    again = program_from_json(program_to_json(program), "a file")
    assert [state.fit_over for state in again.states] == [OVER, OVER]
    whole, _ = compiled(FITTED.replace("over: 40", "over: record"))
    again = program_from_json(program_to_json(whole), "a file")
    assert [evaluations_that_decide([state]) for state in again.states] == [OVER, None]
    # states are found together: the longest counts
    assert evaluations_that_decide(again.states) is None


# ---- training


def trained(stage: str, series: dict[str, FloatArray], rows: list[int]) -> TrainingResult:
    program, spec = compiled(f"{FITTED}train:\n  - {{{stage}}}\n")
    return train(program, dataset(series, train=rows), spec.train, NO_FOLDER)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_gradient_holds_the_starts(engine: str) -> None:
    require_tool("gcc", install="apt install gcc")
    series = records(1, 90, seed=2)
    optimizer = "{sgd: {lr: 0.001, momentum: 0}}"
    stage = f"epochs: 1, dtype: float64, rollout: record, engine: {engine}, optimizer: {optimizer}"
    found = trained(stage, series, [90])
    u, q = series["u"], series["q"]
    start = best_start(6.0, 0.3, u[:OVER], q[:OVER])

    def loss(k: float, d: float) -> float:
        return float(np.mean((positions(k, d, start, u) - q)[OVER:] ** 2))

    moved = 1e-5
    slopes = [
        (loss(6.0 + moved, 0.3) - loss(6.0 - moved, 0.3)) / (2 * moved),
        (loss(6.0, 0.3 + moved) - loss(6.0, 0.3 - moved)) / (2 * moved),
    ]
    # a parameter above 0 is the softplus of its raw value
    raw = np.log(np.expm1([6.0, 0.3]))
    expected = raw - 0.001 * np.array(slopes) / (1 + np.exp(-raw))
    reached = np.log(np.expm1([float(found.weights["k"]), float(found.weights["d"])]))
    assert reached == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize(
    "stage",
    [
        (
            "epochs: 3, dtype: float64, optimizer: {adam: {lr: 0.05}}, "
            "rollout: {horizon: 60, stride: 7}"
        ),
        # with more epochs torch mixes slopes of one epoch's starts with those of the next (0363)
        "epochs: 1, dtype: float64, optimizer: {lbfgs: {iterations: 6}}, rollout: {horizon: 60}",
        "epochs: 3, optimizer: {levenberg_marquardt: {}}, rollout: {horizon: 60, stride: 30}",
    ],
)
def test_both_engines_find_the_same_starts(stage: str) -> None:
    require_tool("gcc", install="apt install gcc")
    series = records(2, 100, seed=4)
    native, torch = (
        trained(f"engine: {engine}, {stage}", series, [100, 100]) for engine in ENGINES
    )
    for name, value in native.weights.items():
        assert value == pytest.approx(torch.weights[name], rel=1e-8)


FED_BACK = """
msnn: 1
name: hidden
sample_time: 1 s
dims: {part: 2}
inputs: {x: m, u: m}
targets: {w: 1}
parameters: {a: 0.5, b: 0.1, c: {dims: part, init: [0.2, 0.3]}}
states: {h: {dims: part, unit: m, next: "c*h + 0.4*x", init: {fit: {over: 6}}}}
outputs:
  y: {expr: "a*x + b*u + sum(h)", predicts: "x[t+1]", unit: m}
  p: {expr: "2*h"}
losses:
  fit: {expr: "mse(y, x[t+1])", rows: w}
  power: {expr: "mae(sum(p), u)", weight: 0.1}
"""


@pytest.mark.parametrize("engine", ENGINES)
def test_starts_of_vectors_behind_closed_signals(engine: str) -> None:
    """Losses of plain numpy, whose start is found by differences of what it simulates."""
    require_tool("gcc", install="apt install gcc")
    random = np.random.default_rng(3)
    series = {"x": random.normal(size=14), "u": random.normal(size=14)}
    series["w"] = np.where(np.arange(14) == 3, 0.0, random.uniform(0.5, 2, 14))
    weights = {"a": np.array(0.5), "b": np.array(0.1), "c": np.array([0.2, 0.3])}
    rollout = "rollout: {horizon: episode, warm_up: 4}"
    stage = f"{rollout}, dtype: float64, engine: {engine}"
    trained, watched, _ = losses(FED_BACK, stage, dataset(series, train=[14]), weights)

    def run(start: FloatArray) -> tuple[FloatArray, FloatArray]:
        h, seen = start.copy(), series["x"][0]
        fit, power = np.zeros(13), np.zeros(13)
        for t in range(13):
            y = 0.5 * seen + 0.1 * series["u"][t] + h.sum()
            fit[t], power[t] = y - series["x"][t + 1], 2 * h.sum() - series["u"][t]
            h = weights["c"] * h + 0.4 * seen
            seen = series["x"][t + 1] if t < 4 else y
        return fit, power

    def rows(start: FloatArray) -> FloatArray:
        fit, power = run(start)
        w = series["w"][:6]
        return np.concatenate([np.sqrt(w / w.sum()) * fit[:6], np.sqrt(0.1 / 6) * power[:6]])

    begin = rows(np.zeros(2))
    design = np.stack([rows(one) - begin for one in np.eye(2)], axis=1)
    best, *_ = np.linalg.lstsq(design, -begin, rcond=None)
    fit, power = run(np.asarray(best, float))
    w = series["w"][6:13]
    for found in (trained, watched):
        assert found["fit"].count == pytest.approx(w.sum(), rel=1e-12)
        assert found["fit"].total == pytest.approx(np.sum(w * fit[6:] ** 2), rel=1e-9)
        assert found["power"].total == pytest.approx(np.sum(np.abs(power[6:])), rel=1e-9)


def test_a_stage_of_single_steps_has_nothing_left_to_score() -> None:
    series = records(1, 90, seed=2)
    with pytest.raises(SpecError, match="the fit of `x` over 40 leaves nothing of a horizon of 1"):
        trained("epochs: 1", series, [90])


def test_a_run_says_how_its_starts_were_found() -> None:
    program, spec = compiled(
        f"{FITTED}train:\n  - {{rollout: 60}}\n"
        "  - {optimizer: {levenberg_marquardt: {}}, rollout: episode}\n"
        "  - {optimizer: {levenberg_marquardt: {}}, rollout: 60}\n"
    )
    plans = plan_stages(program, spec.train, Findings())
    told = [stage_record(plan)["rollout"] for plan in plans]
    starts = [one["starts"] for one in told if isinstance(one, dict)]
    found = {"states": ["x", "v"], "over": OVER}
    assert starts == [
        {**found, "with_parameters": False},
        {**found, "with_parameters": True},
        {**found, "with_parameters": True},
    ]


# ---- parameters and starts together


def least_squares_of_all(
    series: dict[str, FloatArray], rows: int
) -> tuple[FloatArray, FloatArray, float]:
    """k, d with all starts, their standard errors, σ: every residual of every record."""
    u, q = series["u"].reshape(-1, rows), series["q"].reshape(-1, rows)

    def residuals(numbers: FloatArray) -> FloatArray:
        starts = numbers[2:].reshape(-1, 2)
        k, d = float(numbers[0]), float(numbers[1])
        runs = [positions(k, d, s, f) for s, f in zip(starts, u, strict=True)]
        return (np.array(runs) - q).ravel()

    begin = np.concatenate([[5.0, 0.2], np.stack([q[:, 0], 0 * q[:, 0]], axis=1).ravel()])
    found = least_squares(residuals, begin, xtol=1e-15, ftol=1e-15, gtol=1e-15)
    rest = float(np.sum(found.fun**2)) / (len(found.fun) - len(found.x))
    spread = rest * np.linalg.inv(found.jac.T @ found.jac)
    return found.x[:2], np.sqrt(np.diagonal(spread))[:2], float(np.sqrt(rest))


@pytest.mark.parametrize("horizon", ["episode", "record", "60"])
def test_levenberg_marquardt_estimates_starts_with_the_parameters(horizon: str) -> None:
    require_tool("gcc", install="apt install gcc")
    series = records(3, 60, seed=6)
    optimizer = "{levenberg_marquardt: {tolerance: 1e-14}}"
    stage = f"train:\n  - {{epochs: 30, optimizer: {optimizer}, rollout: {horizon}}}\n"
    program, spec = compiled(FITTED + stage)
    data = dataset(series, train=[60] * 3)
    found = train(program, data, spec.train, NO_FOLDER)
    expected, spread, noise = least_squares_of_all(series, 60)
    assert [found.weights["k"], found.weights["d"]] == pytest.approx(expected, rel=1e-6)
    (plan,) = plan_stages(program, spec.train, Findings())
    errors = standard_errors(plan, data, found.weights)
    # of slopes by differences in `least_squares`
    assert [errors.errors["k"], errors.errors["d"]] == pytest.approx(spread, rel=1e-5)
    assert errors.noise["y"] == pytest.approx(noise, rel=1e-6)
    assert errors.residuals == 180


class Totals(Silent):
    """The total of every epoch before its step."""

    def __init__(self) -> None:
        self.totals: list[float] = []

    def epoch_ended(self, event: EpochEnd) -> None:
        self.totals.append(event.total)


DRIFTING = """
msnn: 1
name: drifting
sample_time: 1 s
inputs: {u: 1}
targets: {y: 1}
parameters: {a: 0.9, b: 0.05, c: 1.5, p: 0}
states:
  x: {next: "a*x + b*u", init: {fit: {over: 3}}}
  v: {next: "0.98*v + p*x", init: {fit: {over: 3}}}
outputs: {y_hat: {expr: "c*x + v", predicts: "y[t]"}}
"""


def drifting(rows: int) -> dict[str, FloatArray]:
    """Two slow states of which the sum is measured: three rows tell little of either."""
    random = np.random.default_rng(1)
    u = np.sign(np.sin(0.05 * np.arange(rows))) + 0.3 * random.normal(size=rows)
    y, x, v = np.zeros(rows), 1.0, 0.5
    for t in range(rows):
        y[t] = x + v
        x, v = 0.95 * x + 0.1 * u[t], 0.98 * v + 0.03 * x
    return {"u": u, "y": y + 0.05 * random.normal(size=rows)}


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("rollout", ["{horizon: 30, stride: 5}", "{horizon: 60, stride: 60}"])
def test_levenberg_marquardt_descends_in_short_rollouts(engine: str, rollout: str) -> None:
    """Starts that are found anew in each epoch and held in its step made the total rise."""
    require_tool("gcc", install="apt install gcc")
    optimizer = "optimizer: {levenberg_marquardt: {}}"
    stage = f"epochs: 8, engine: {engine}, {optimizer}, rollout: {rollout}"
    program, spec = compiled(f"{DRIFTING}train:\n  - {{{stage}}}\n")
    told = Totals()
    train(program, dataset(drifting(300), train=[300]), spec.train, NO_FOLDER, told)
    assert all(after <= before for before, after in itertools.pairwise(told.totals))
    # the variance of the noise
    assert told.totals[-1] < 1.05 * 0.05**2


def test_starts_stay_variables_on_the_way_to_whole_rollouts() -> None:
    require_tool("gcc", install="apt install gcc")
    curriculum = ", curriculum: {2: 50, 5: 60}"
    rollout = f"{{horizon: 90, stride: 90{curriculum}}}"
    stage = f"epochs: 30, optimizer: {{levenberg_marquardt: {{}}}}, rollout: {rollout}"
    series = records(2, 90, seed=6)
    found = trained(stage, series, [90, 90])
    right = trained(stage.replace(curriculum, ""), series, [90, 90])
    for name, value in found.weights.items():
        assert value == pytest.approx(right.weights[name], rel=1e-6)


def test_a_stage_without_any_target_ends() -> None:
    """The validation rows have targets, so that something judges it."""
    series = records(2, 90, seed=2)
    series["q"][:90] = np.nan
    stage = "epochs: 5, rollout: record, optimizer: levenberg_marquardt, engine: torch"
    model = FITTED.replace(", from: q.meas", "")
    program, spec = compiled(f"{model}train:\n  - {{{stage}}}\n")
    data = dataset(series, train=[90], val=[90])
    found = train(program, data, spec.train, NO_FOLDER)
    assert found.stages[0].reason == "nothing is scored"


def test_torch_estimates_them_too() -> None:
    series = records(2, 45, seed=6)
    stage = "epochs: 3, optimizer: {levenberg_marquardt: {}}, rollout: episode"
    native, torch = (trained(f"{stage}, engine: {e}", series, [45, 45]) for e in ENGINES)
    for name, value in native.weights.items():
        assert value == pytest.approx(torch.weights[name], rel=1e-9)


@pytest.mark.parametrize("seed", range(8))
def test_estimates_are_within_their_errors_of_the_truth(seed: int) -> None:
    """Three standard errors: of 16 numbers one is farther off in 4 of 100 of such tests."""
    require_tool("gcc", install="apt install gcc")
    series = records(3, 200, seed=100 + seed)
    stage = "train:\n  - {epochs: 30, optimizer: {levenberg_marquardt: {}}, rollout: episode}\n"
    program, spec = compiled(FITTED + stage)
    data = dataset(series, train=[200] * 3)
    found = train(program, data, spec.train, NO_FOLDER)
    (plan,) = plan_stages(program, spec.train, Findings())
    errors = standard_errors(plan, data, found.weights).errors
    for name, true in TRUE.items():
        assert abs(found.weights[name] - true) < 3 * errors[name]


# ---- going on after an interruption


class Interrupting(Silent):
    """Sends Ctrl-C to this process when an epoch ends."""

    def __init__(self, epoch: int) -> None:
        self._epoch = epoch

    def epoch_ended(self, event: EpochEnd) -> None:
        if event.epoch == self._epoch:
            os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.parametrize(
    "stage",
    [
        "batch: 4, optimizer: {adam: {lr: 0.05}}, rollout: {horizon: 60, stride: 7}",
        "optimizer: {levenberg_marquardt: {damping: 9}}, rollout: episode",
        "optimizer: {levenberg_marquardt: {damping: 9}}, rollout: {horizon: 60, stride: 30}",
    ],
)
def test_resuming_continues_bit_for_bit(stage: str, tmp_path: Path) -> None:
    require_tool("gcc", install="apt install gcc")
    program, spec = compiled(f"{FITTED}train:\n  - {{epochs: 5, {stage}}}\n")
    data = dataset(records(2, 100, seed=4), train=[100, 100])
    undisturbed = train(program, data, spec.train, NO_FOLDER)
    with pytest.raises(TrainingInterruptedError):
        train(program, data, spec.train, TrainingOptions(runs=tmp_path), Interrupting(2))
    resumed = train(program, data, spec.train, TrainingOptions(runs=tmp_path, resume=True))
    for name, value in undisturbed.weights.items():
        np.testing.assert_array_equal(resumed.weights[name], value)


# ---- by kernels


@pytest.mark.parametrize("rows", [False, True])
def test_kernels_find_the_starts_that_the_interpreter_finds(
    rows: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    require_tool("gcc", install="apt install gcc")
    series = records(3, 400, seed=8)
    series["q"][[3, 30, 31, 404]] = np.nan
    program, _ = compiled(FITTED)
    data = dataset(series, train=[400] * 3)
    some = {"y": np.arange(1200) % 3 != 1} if rows else None
    runs = Runs(np.array([800, 0, 400, 410]), np.array([400, 400, 400, 20]), 0, 400)

    def found(native: bool) -> FoundStarts:
        fit = StartFit(program, None, 5, searches=1000, native=native)
        return fit.find(data.series, runs, TRUE, {"y": 2.0}, some)

    right = found(native=False)
    # no step may be interpreted
    monkeypatch.setattr("msnn.simulation.start_products.moments", None)
    by_kernel = found(native=True)
    for name, value in right.values.items():
        assert by_kernel.values[name] == pytest.approx(value, rel=1e-9)


def test_standard_errors_beside_a_long_record_are_computed_by_kernels(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Interpreting a record of 20,000 rows took 30 times as long as the training."""
    require_tool("gcc", install="apt install gcc")
    stage = "train:\n  - {epochs: 1, optimizer: levenberg_marquardt, rollout: record}\n"
    program, spec = compiled(FITTED + stage)
    data = dataset(records(1, 20_000, seed=3), train=[20_000])
    (plan,) = plan_stages(program, spec.train, Findings())
    monkeypatch.setattr("msnn.simulation.start_products.moments", None)
    errors = standard_errors(plan, data, {n: np.array(v) for n, v in TRUE.items()})
    assert errors.noise["y"] == pytest.approx(NOISE, rel=0.02)

"""Rule R12: stages in order, each from the best weights of the one before, and what they move."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from msnn.data.dataset import IntArray
from msnn.data.rollout_rows import Runs
from msnn.model.weights.weights_file import read_weights
from msnn.project.workflow_checks import checked_model
from msnn.simulation.rollout import LossSum
from msnn.training.engines.engine import EngineState, batches_of
from msnn.training.plans.epochs import order_key, shuffled
from msnn.training.plans.stage_data import StageData
from msnn.training.plans.stage_plan import fixed_starts, plan_stages
from msnn.training.records.progress import EpochEnd, StageEnd, StageStart
from msnn.training.records.run_record import stage_record
from msnn.training.stages.stage_run import StageRun
from msnn.training.train import TrainingOptions, TrainingResult, train
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings, SpecError
from tests.training.cases import compiled, dataset, gain, gain_series

IN_MEMORY = TrainingOptions(runs=None)
FAST = "optimizer: {adam: {lr: 0.05}}, dtype: float64"


@dataclass
class Recorder:
    """Keeps every event of a run."""

    stages: list[StageStart] = field(default_factory=list[StageStart])
    epochs: list[EpochEnd] = field(default_factory=list[EpochEnd])
    ends: list[StageEnd] = field(default_factory=list[StageEnd])
    warnings: list[Diagnostic] = field(default_factory=list[Diagnostic])

    def stage_started(self, event: StageStart) -> None:
        self.stages.append(event)

    def epoch_ended(self, event: EpochEnd) -> None:
        self.epochs.append(event)

    def stage_ended(self, event: StageEnd) -> None:
        self.ends.append(event)

    def warned(self, diagnostic: Diagnostic) -> None:
        self.warnings.append(diagnostic)


def run(stages: str, recorder: Recorder | None = None, **sets: list[int]) -> TrainingResult:
    program, spec = gain(stages)
    data = dataset(gain_series(200), **(sets or {"train": [60], "val": [40]}))
    return train(program, data, spec.train, IN_MEMORY, recorder or Recorder())


def test_training_finds_the_parameters() -> None:
    """docs/language.md, Training (R12)."""
    result = run(f"  - {{epochs: 200, batch: 16, {FAST}}}\n")
    # Adam at this rate wanders by a few 1e-4 around the minimum
    assert result.weights["a"] == pytest.approx(0.8, abs=2e-3)
    assert result.weights["b"] == pytest.approx(0.3, abs=2e-3)


def test_a_stage_begins_with_the_best_of_the_one_before() -> None:
    """docs/language.md, Training (R12)."""
    recorder = Recorder()
    result = run(
        f"  - {{epochs: 20, batch: 16, {FAST}}}\n"
        # far too fast to improve anything: its best is what it began with
        "  - {epochs: 3, dtype: float64, optimizer: {sgd: {lr: 30}}, clip: 1}\n",
        recorder,
    )
    assert recorder.ends[1].best == pytest.approx(recorder.ends[0].best, rel=1e-12)
    assert recorder.ends[1].best_epoch == 0
    (said,) = (warning for warning in recorder.warnings if warning.code == "W0912")
    assert said.message.startswith("stage `stage_2` has learned nothing: no epoch is better than")
    # who trains from Python without lines of progress is told too
    assert result.warnings == tuple(recorder.warnings)


def test_frozen_parameters_keep_every_bit_and_only_in_their_stage() -> None:
    """docs/language.md, Training (R12)."""
    program, spec = gain(
        f"  - {{epochs: 3, freeze: b, {FAST}}}\n  - {{epochs: 3, freeze: a, {FAST}}}\n"
    )
    data = dataset(gain_series(100), train=[60], val=[40])
    result = train(program, data, spec.train, IN_MEMORY)
    first, second = result.stages
    assert first.best["b"] == 0.0
    assert first.best["a"] != 0.5
    assert second.best["a"] == first.best["a"]
    assert second.best["b"] != 0.0


def test_a_factor_of_zero_holds_a_parameter() -> None:
    """docs/language.md, Training (R12)."""
    result = run(f"  - {{epochs: 2, lr: {{b: 0}}, {FAST}}}\n")
    assert result.weights["b"] == 0.0


def test_loss_weights_of_a_stage_replace_those_they_name() -> None:
    """docs/language.md, Training (R12)."""
    program, spec = gain(
        "  - {losses: {small: 0.5}}\n",
        'losses: {fit: "mse(x_next, x[t+1])", small: {expr: "l2(a)", weight: 2}}\n',
    )
    (plan,) = plan_stages(program, spec.train, Findings())
    assert plan.loss_weights == {"fit": 1.0, "small": 0.5}


def test_defaults_of_a_stage() -> None:
    """docs/language.md, Training (R12)."""
    program, spec = gain("  - {}\n")
    (plan,) = plan_stages(program, spec.train, Findings())
    assert (plan.epochs, plan.batch, plan.rollout.horizon, plan.rollout.stride) == (100, 128, 1, 1)
    assert stage_record(plan)["optimizer"] == {
        "adam": {"lr": 1e-3, "beta1": 0.9, "beta2": 0.999, "eps": 1e-8}
    }


def test_best_is_decided_on_val_and_else_on_train() -> None:
    """docs/language.md, Training (R12)."""
    recorder = Recorder()
    run(f"  - {{epochs: 1, {FAST}}}\n", recorder)
    run(f"  - {{epochs: 1, {FAST}}}\n", recorder, train=[60])
    assert [stage.monitored_on for stage in recorder.stages] == ["val", "train"]


def test_the_monitor_uses_the_rollout_of_the_stage_at_stride_horizon() -> None:
    """docs/language.md, Training (R12)."""
    program, spec = gain(f"  - {{epochs: 1, rollout: {{horizon: 8, stride: 1}}, {FAST}}}\n")
    from msnn.training.plans.stage_data import stage_data

    data = dataset(gain_series(100), train=[30], val=[21])
    (plan,) = plan_stages(program, spec.train, Findings())
    found = stage_data(plan, data, Findings())
    assert found is not None
    assert len(found.train) == 22  # 29 samples, 8 evaluations each
    assert found.watched.t0.tolist() == [30, 38, 46]
    assert found.watched.steps.tolist() == [8, 8, 4]


def test_early_stop_waits_for_its_patience() -> None:
    """docs/language.md, Training (R12)."""
    recorder = Recorder()
    run(
        "  - {epochs: 50, dtype: float64, optimizer: {sgd: {lr: 30}}, clip: 1,"
        " early_stop: {patience: 4}}\n",
        recorder,
    )
    assert recorder.ends[0].epochs == 4
    assert recorder.ends[0].reason == "no better for 4 epochs"


def test_the_same_seed_gives_the_same_weights_and_another_does_not() -> None:
    """docs/language.md, Training (R12)."""
    results = [
        run(f"  - {{epochs: 3, batch: 7, seed: {seed}, {FAST}}}\n").weights["a"]
        for seed in (1, 1, 2)
    ]
    assert results[0] == results[1]
    assert results[0] != results[2]


def test_starts_are_shuffled_anew_each_epoch() -> None:
    """docs/language.md, Training (R12)."""
    orders = [shuffled(20, order_key(0, 0, epoch)).tolist() for epoch in range(3)]
    assert all(sorted(order) == list(range(20)) for order in orders)
    assert orders[0] != orders[1] != orders[2]


def test_seed_stage_epoch_and_attempt_decide_the_order() -> None:
    keys = [order_key(1, 0, 0, 0), order_key(0, 1, 0, 0), order_key(0, 0, 1, 0)]
    assert len({*keys, order_key(0, 0, 0, 0), order_key(0, 0, 0, 1)}) == 5


@pytest.mark.parametrize(("attempt", "index"), [(0, 0), (2, 0), (0, 1)])
def test_a_stage_orders_its_starts_by_its_own_key(attempt: int, index: int) -> None:
    program, spec = gain("  - {epochs: 2, batch: 8, seed: 5}\n" * 2)
    plan = plan_stages(program, spec.train, Findings())[index]
    engine = Counting()
    StageRun(
        plan=plan,
        engine=engine,
        data=few_starts(),
        stop_asked=lambda: False,
        epoch_ended=lambda event: None,
        attempt=attempt,
    ).run()
    expected = [shuffled(21, order_key(5, index, epoch, attempt)).tolist() for epoch in range(2)]
    assert sum(engine.batches, []) == sum(expected, [])  # noqa: RUF017  (short lists)


def test_every_order_is_as_likely_as_any_other() -> None:
    """docs/language.md, Training (R12)."""
    counts = Counter(tuple(shuffled(4, key).tolist()) for key in range(24_000))
    assert len(counts) == 24
    squares = sum((count - 1000) ** 2 / 1000 for count in counts.values())
    assert squares < 49.7  # χ² of 23 degrees of freedom exceeds it once in a thousand times


class Counting:
    """An engine that counts what it is given."""

    batches_a_call = 2
    left_out = 0
    has_left_out = False
    finished: str | None = None

    def __init__(self) -> None:
        self.batches: list[list[int]] = []

    def weights(self) -> dict[str, np.ndarray]:
        return {}

    def begin_epoch(self, epoch: int, rate: float, attempt: int = 0, spread: float = 0.0) -> None:
        del epoch, rate, attempt, spread

    def measure(self, runs: Runs) -> dict[str, LossSum]:
        return self.evaluate(runs)

    def write(self, series: Mapping[str, np.ndarray], *, watched: bool) -> None:
        raise AssertionError("no start is found here")

    def train_batches(
        self,
        runs: Runs,
        size: int,
        members: IntArray | None = None,
        before: dict[str, LossSum] | None = None,
    ) -> dict[str, LossSum]:
        assert members is not None
        runs = runs.take(members)
        self.batches += [batch.t0.tolist() for batch in batches_of(runs, size)]
        found = LossSum(float(len(runs)), len(runs))
        return {"x_next": found + (before or {}).get("x_next", LossSum(0.0, 0))}

    def order(self, count: int, key: int) -> IntArray:
        return shuffled(count, key)

    def evaluate(self, runs: Runs) -> dict[str, LossSum]:
        return {"x_next": LossSum(0.0, len(runs))}

    def state(self) -> EngineState:
        return EngineState({}, None)

    def restore(self, state: EngineState) -> None:
        del state


def few_starts() -> StageData:
    """21 starts, which are watched, too."""
    runs = Runs(np.arange(21), np.ones(21, dtype=np.int64), 0, 22)
    return StageData(
        train=runs, train_rows=None, watched=runs, watched_rows=None, watched_set="train"
    )


def test_an_epoch_visits_every_start_once_and_the_last_batch_is_smaller() -> None:
    """docs/language.md, Training (R12)."""
    program, spec = gain("  - {epochs: 1, batch: 8}\n")
    (plan,) = plan_stages(program, spec.train, Findings())
    engine = Counting()
    epochs: list[EpochEnd] = []
    StageRun(
        plan=plan,
        engine=engine,
        data=few_starts(),
        stop_asked=lambda: False,
        epoch_ended=epochs.append,
    ).run()
    assert [len(batch) for batch in engine.batches] == [8, 8, 5]
    assert sorted(sum(engine.batches, [])) == list(range(21))  # noqa: RUF017  (short lists)
    assert epochs[0].total == 1.0  # the mean over starts, not over batches


def test_a_resumed_epoch_knows_of_the_batches_that_were_left_out() -> None:
    program, spec = gain("  - {epochs: 1, batch: 8}\n")
    (plan,) = plan_stages(program, spec.train, Findings())
    data = few_starts()

    def attempt() -> StageRun:
        return StageRun(
            plan=plan,
            engine=Counting(),
            data=data,
            stop_asked=lambda: False,
            epoch_ended=lambda event: None,
        )

    killed, resumed = attempt(), attempt()
    killed.best, killed.left_out = {}, 1
    place = killed.place()
    assert place is not None
    resumed.resume(place)
    assert resumed.engine.has_left_out


def test_lbfgs_takes_all_starts_at_once_and_fits_a_linear_model() -> None:
    result = run("  - {epochs: 3, dtype: float64, optimizer: {lbfgs: {}}}\n")
    assert result.weights["a"] == pytest.approx(0.8, abs=1e-6)
    assert result.weights["b"] == pytest.approx(0.3, abs=1e-6)


@pytest.mark.parametrize("horizon", ["5", "3 s", "episode", "record"])
def test_every_horizon_trains(horizon: str) -> None:
    recorder = Recorder()
    run(f"  - {{epochs: 15, rollout: {horizon}, {FAST}}}\n", recorder)
    assert recorder.ends[0].best < 0.5 * recorder.epochs[0].total


@pytest.mark.parametrize(
    ("stage", "code"),
    [
        ("{rollout: 2.5 s}", "E0601"),
        ("{rollout: {horizon: 2, close: [u]}}", "E0902"),
        ("{rollout: {horizon: 4, skip: 4}}", "E0903"),
        ("{freeze: '*'}", "E0904"),
        ("{lr: {a: 0.1}, optimizer: {lbfgs: {}}}", "E0905"),
        ("{losses: {x_nxt: 1}}", "E0906"),
        ("{losses: {x_next: 0}}", "E0907"),
        ("{freeze: [aa]}", "E0908"),
        ("{early_stop: {monitor: nothing}}", "E0906"),
        ("{rollout: 100}", "E0821"),
        ("{optimizer: {adam: {lr: 1e300}}}", "E0353"),
        ("{optimizer: {lbfgs: {lr: 1e39}}}", "E0353"),
        ("{optimizer: {sgd: {lr: 1e30}}, lr: {a: 1e10}}", "E0353"),
        ("{optimizer: {torch: {name: RAdam, options: {lr: 1e300}}}, engine: torch}", "E0353"),
    ],
)
def test_faults_of_a_stage_have_a_code(stage: str, code: str) -> None:
    with pytest.raises(SpecError) as caught:
        run(f"  - {stage}\n")
    assert [d.code for d in caught.value.diagnostics if d.severity == "error"] == [code]


def test_without_training_data_the_set_is_named() -> None:
    with pytest.raises(SpecError, match="no data in the set `train`"):
        run("  - {}\n", None, test=[50])


def test_a_static_model_trains_on_independent_rows() -> None:
    program, spec = compiled(
        "msnn: 1\nname: p\ninputs: {u: 1}\ntargets: {y: 1}\nparameters: {a: 0.5}\n"
        'outputs: {z: {expr: a*u, predicts: "y[t]"}}\n'
        "train: [{epochs: 3, dtype: float64, optimizer: {lbfgs: {}}}]\n"
    )
    u = np.linspace(-1, 1, 20)
    data = dataset({"u": u, "y": 3 * u}, train=[15], val=[5])
    assert train(program, data, spec.train, IN_MEMORY).weights["a"] == pytest.approx(3.0, rel=1e-9)


def test_only_inputs_are_closed_by_default() -> None:
    """docs/language.md, Rollouts (R4)."""
    program, spec = compiled(
        "msnn: 1\nname: p\nsample_time: 1 s\ninputs: {u: 1, v: 1}\nparameters: {a: 0.5}\n"
        "states: {x: {next: a*x + u + v, init: x.meas}}\n"
        'outputs: {y: {expr: next(x), predicts: "x[t+1]"}, w: {expr: a*v, predicts: "v[t+1]"}}\n'
        "train: [{rollout: 3}, {rollout: {horizon: 3, close: []}}]\n"
    )
    plans = plan_stages(program, spec.train, Findings())
    assert [plan.rollout.closed for plan in plans] == [("v",), ()]


def test_fixed_starts_inside_a_record_are_a_warning() -> None:
    """docs/language.md, States (R7)."""
    text = (
        "msnn: 1\nname: p\nsample_time: 1 s\ninputs: {u: 1}\nparameters: {a: 0.5}\n"
        'states: {x: {next: "a*x + u", init: 0}}\n'
        'outputs: {y: {expr: next(x), predicts: "x[t+1]"}}\n'
        "train: [{epochs: 1}, {epochs: 1, rollout: record}]\n"
    )
    program, spec = compiled(text)
    series = {"u": np.ones(20)} | {s.name: np.ones(20) for s in program.signals if s.name != "u"}
    recorder = Recorder()
    train(program, dataset(series, train=[20]), spec.train, IN_MEMORY, recorder)
    said = [(w.code, "stage_1" in w.message) for w in recorder.warnings if w.code != "W0912"]
    assert said == [("W0901", True)]


@pytest.mark.parametrize(
    ("rollout", "warns"),
    [("record", False), ("3", True), ("{horizon: 3, stride: 3}", True)],
)
def test_check_and_training_warn_of_the_same_starts(
    tmp_path: Path, rollout: str, warns: bool
) -> None:
    """docs/language.md, States (R7)."""
    file = tmp_path / "p.msnn.yaml"
    file.write_text(
        "msnn: 1\nname: p\nsample_time: 1 s\ninputs: {u: 1}\nparameters: {a: 0.5}\n"
        'states: {x: {next: "a*x + u", init: 0}}\n'
        'outputs: {y: {expr: next(x), predicts: "x[t+1]"}}\n'
        f"data: {{source: {{train: none.csv}}}}\ntrain: [{{epochs: 1, rollout: {rollout}}}]\n"
    )
    model = checked_model(file)
    series = {name: np.ones(20) for name in ("u", "x")}
    recorder = Recorder()
    data = dataset(series, train=[20])
    train(model.program, data, model.spec.train, IN_MEMORY, recorder)
    for warnings in (model.warnings, recorder.warnings):
        assert ("W0901" in [w.code for w in warnings]) == warns


def test_one_rollout_a_record_is_no_warning_of_training() -> None:
    """docs/language.md, States (R7)."""
    text = (
        "msnn: 1\nname: p\nsample_time: 1 s\ninputs: {u: 1}\nparameters: {a: 0.5}\n"
        'states: {x: {next: "a*x + u", init: 0}}\n'
        'outputs: {y: {expr: next(x), predicts: "x[t+1]"}}\n'
        "train: [{epochs: 1, rollout: 5}]\n"
    )
    program, spec = compiled(text)
    series = {name: np.ones(12) for name in ("u", "x")}
    recorder = Recorder()
    train(program, dataset(series, train=[6, 6]), spec.train, IN_MEMORY, recorder)
    assert "W0901" not in [w.code for w in recorder.warnings]


@pytest.mark.parametrize(("skip", "warns"), [(0, True), (1, False)])
def test_a_memory_that_is_skipped_has_forgotten_its_start(skip: int, warns: bool) -> None:
    """docs/language.md, States (R7)."""
    program, spec = compiled(
        "msnn: 1\nname: p\nsample_time: 1 s\ninputs: {u: 1}\ntargets: {y: 1}\n"
        "layers: {h: {iir: {num: 1, den: 1}}}\noutputs: {z: {expr: h(u), predicts: y}}\n"
        f"train: [{{epochs: 1, rollout: {{horizon: 3, skip: {skip}}}}}]\n"
    )
    (plan,) = plan_stages(program, spec.train, Findings())
    assert [found.code for found in fixed_starts(plan)] == (["W0901"] if warns else [])


@pytest.mark.parametrize(
    ("value", "losses", "states"),
    [
        ("u", "l2(integral(y.meas - z))", []),
        ("u + area", "mse(z, y)", ["integral.state"]),
        ("u + area", "mse(z, y) + 0.1 * l2(integral(u))", ["integral.state"]),
        ("u + der(u - 1)", "mse(z, y)", []),
        ("h(u)", "mse(z, y)", ["h.state"]),
    ],
)
def test_what_is_of_the_run_alone_starts_anywhere(
    value: str, losses: str, states: list[str]
) -> None:
    """docs/language.md, States (R7)."""
    text = (
        "msnn: 1\nname: p\nsample_time: 1 s\ninputs: {u: 1}\ntargets: {y: 1}\n"
        "parameters: {a: 0.5}\nlayers: {h: {iir: {num: 1, den: 1}}}\n"
        f'equations: {{area: integral(u)}}\noutputs: {{z: "a * ({value})"}}\n'
        f'losses: {{fit: "{losses}"}}\ntrain: [{{epochs: 1, rollout: 3}}]\n'
    )
    program, spec = compiled(text)
    recorder = Recorder()
    data = dataset({"u": np.ones(20), "y": np.ones(20)}, train=[20])
    train(program, data, spec.train, IN_MEMORY, recorder)
    said = [w.message.split("`")[3] for w in recorder.warnings if w.code == "W0901"]
    assert said == states


def test_a_run_is_kept_with_its_metrics_weights_and_spec(tmp_path: Path) -> None:
    program, spec = gain(f"  - {{name: only, epochs: 3, {FAST}}}\n")
    data = dataset(gain_series(100), train=[60], val=[40])
    options = TrainingOptions(runs=tmp_path, spec_text="the text")
    result = train(program, data, spec.train, options)
    assert result.folder is not None
    lines = (result.folder / "metrics.jsonl").read_text().splitlines()
    records = [json.loads(line) for line in lines]
    assert [record["epoch"] for record in records] == [1, 2, 3]
    assert (result.folder / "spec.msnn.yaml").read_text() == "the text"
    description = json.loads((result.folder / "run.json").read_text())
    assert description["stages"][0]["name"] == "only"
    assert description["data"]["rows"] == {"train": 60, "val": 40}
    assert len(description["data"]["sha256"]) == 64
    assert description["spec_sha256"] == program.spec_hash
    assert set(description["versions"]) == {"msnn", "python", "numpy", "torch"}
    latest = read_weights(tmp_path / "gain" / "latest" / "weights.safetensors", program)
    assert latest["a"] == result.weights["a"]
    assert not (result.folder / "checkpoint.safetensors").exists()
    again = train(program, data, spec.train, options)
    assert again.folder != result.folder
    assert (tmp_path / "gain" / "latest").resolve() == again.folder


def test_files_with_episodes_that_are_too_short_are_named() -> None:
    program, spec = gain("  - {epochs: 1, rollout: 10}\n")
    data = dataset(gain_series(60), train=[30, 4, 20, 6])
    result = train(program, data, spec.train, TrainingOptions(runs=None))
    (message,) = (warning.message for warning in result.warnings if warning.code == "W0802")
    assert "skips 2 of 4 episodes" in message
    assert message.endswith("in train1.csv, train3.csv")


@pytest.mark.parametrize("watched", ["val", "train"])
def test_a_stage_that_nothing_judges_is_refused(watched: str) -> None:
    """Its monitor would be 0 from the beginning, and the initial weights would win."""
    program, spec = compiled(
        """
msnn: 1
name: apart
sample_time: 1 s
inputs: {u: m}
targets: {y: m}
parameters: {b: 0.0}
outputs: {z: {expr: "b*u", unit: m, predicts: "y[t]"}}
train: [{epochs: 1}]
"""
    )
    random = np.random.default_rng(0)
    series = {"u": random.normal(size=60), "y": random.normal(size=60)}
    missing = slice(40, 60) if watched == "val" else slice(0, 60)
    series["y"][missing] = np.nan
    sets = {"train": [40], "val": [20]} if watched == "val" else {"train": [60]}
    with pytest.raises(SpecError) as caught:
        train(program, dataset(series, **sets), spec.train, TrainingOptions(runs=None))
    assert [found.code for found in caught.value.diagnostics] == ["E0909"]
    assert f"`{watched}`" in caught.value.diagnostics[0].message

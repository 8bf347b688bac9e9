"""A checkpoint gives back every fact of where a run stands, and a stage goes on with each."""

from __future__ import annotations

from dataclasses import MISSING, fields, is_dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from msnn.data.dataset import IntArray
from msnn.data.rollout_rows import Runs
from msnn.simulation.rollout import LossSum
from msnn.training.engines.engine import EngineState, LossSums
from msnn.training.plans.epochs import Reductions, shuffled
from msnn.training.plans.stage_data import StageData
from msnn.training.plans.stage_plan import plan_stages
from msnn.training.plans.stage_result import EstimatedStarts, StageResult, Weights
from msnn.training.records import checkpoint
from msnn.training.records.checkpoint import (
    Checkpoint,
    TrainingPosition,
    read_checkpoint,
    write_checkpoint,
)
from msnn.training.stages.stage_run import Interrupted, StageAttempts, StageRun
from spec_schema.diagnostics.diagnostic import Findings, SpecError
from tests.backends.test_atomic_write import waits_for_disk
from tests.training.cases import gain

PLACE = TrainingPosition(
    epoch=11,
    batch=3,
    sums={"fit": LossSum(0.125, 7.0), "size": LossSum(2.5, 9.0)},
    left_out=2,
    best_value=0.0625,
    best_epoch=5,
    best={"a": np.array(0.25), "w": np.array([1.5, -2.0])},
    engine=EngineState({"raw": np.array([3.0])}, {"engine": "native", "steps": 17}),
    reductions=Reductions(count=4, epoch=8),
    spread=0.75,
    found_rate=0.03125,
    seconds=12.5,
    starts={"x": np.array([[6.0], [7.0]])},
    best_starts=EstimatedStarts(
        t0=np.array([31, 32]), steps=np.array([33, 34]), values={"x": np.array([[8.0], [9.0]])}
    ),
)
"""No two numbers are alike, so that one in the place of another shows."""


def result(number: int) -> StageResult:
    return StageResult(
        best={"a": np.array(float(number))},
        best_value=100.0 + number,
        best_epoch=200 + number,
        epochs=300 + number,
        reason=f"reason {number}",
        seconds=400.0 + number,
        attempt=500 + number,
        starts=EstimatedStarts(
            t0=np.array([600 + number]),
            steps=np.array([700 + number]),
            values={"x": np.array([800.0 + number])},
        ),
    )


CHECKPOINT = Checkpoint(
    ended=(result(1), result(2)),
    begin={"a": np.array(0.5)},
    attempt=6,
    leader=result(3),
    place=PLACE,
    metrics=4321,
)


def assert_same(kept: object, wanted: object, name: str) -> None:
    """Every field at any depth, arrays with their types."""
    if is_dataclass(wanted):
        assert type(kept) is type(wanted), name
        for field in fields(wanted):
            here = f"{name}.{field.name}"
            assert_same(getattr(kept, field.name), getattr(wanted, field.name), here)
    elif isinstance(wanted, np.ndarray):
        np.testing.assert_array_equal(np.asarray(kept), wanted, err_msg=name, strict=True)
    elif isinstance(wanted, dict):
        given, asked = cast("dict[str, Any]", kept), cast("dict[str, Any]", wanted)
        assert given.keys() == asked.keys(), name
        for key, value in asked.items():
            assert_same(given[key], value, f"{name}[{key}]")
    elif isinstance(wanted, tuple):
        for number, pair in enumerate(zip(cast("Any", kept), cast("Any", wanted), strict=True)):
            assert_same(*pair, f"{name}[{number}]")
    else:
        assert kept == wanted, name


class NoSteps:
    """An engine that takes no step: a batch leaves all as it is."""

    has_left_out = False
    left_out = 0
    finished = None
    batches_a_call = 1

    def __init__(self) -> None:
        self.kept = EngineState({}, None)
        self.began: list[tuple[int, float, int, float]] = []

    def state(self) -> EngineState:
        return self.kept

    def restore(self, state: EngineState) -> None:
        self.kept = state

    def order(self, count: int, key: int) -> IntArray:
        return shuffled(count, key)

    def begin_epoch(self, epoch: int, rate: float, attempt: int = 0, spread: float = 0.0) -> None:
        self.began.append((epoch, rate, attempt, spread))

    def write(self, series: Weights, *, watched: bool) -> None:
        assert not series
        assert not watched

    def train_batches(self, runs: Runs, size: int, members: IntArray, before: LossSums) -> LossSums:
        assert len(runs.take(members)) == size
        return before


class KnownStarts:
    """Starts that are never found, only those of the interrupted epoch are told."""

    def __init__(self) -> None:
        self.told: Weights = {}

    def kept(self, runs: Runs, values: Weights) -> Weights:
        del runs
        self.told = values
        return {}

    def values(self) -> Weights:
        return self.told


def test_every_fact_of_a_checkpoint_is_read_back(tmp_path: Path) -> None:
    for each in (CHECKPOINT, PLACE):
        for field in fields(each):
            default = field.default
            assert default is MISSING or getattr(each, field.name) != default, field.name
    path = tmp_path / "checkpoint.safetensors"
    write_checkpoint(path, CHECKPOINT)
    assert_same(read_checkpoint(path), CHECKPOINT, "checkpoint")


def test_no_bit_of_a_checkpoint_can_flip_unseen(tmp_path: Path) -> None:
    """It is refused, or says the same: some bits are blanks, or the names of nothing."""
    path = tmp_path / "checkpoint.safetensors"
    write_checkpoint(path, CHECKPOINT)
    content = path.read_bytes()
    bits = np.random.default_rng(0).integers(8, size=len(content))
    refused = 0
    places = range(0, len(content), 3)
    for place in places:
        bit = bits[place]
        damaged = bytearray(content)
        damaged[place] ^= 1 << int(bit)
        path.write_bytes(damaged)
        try:
            assert_same(read_checkpoint(path), CHECKPOINT, f"byte {place}, bit {bit}")
        except SpecError as error:
            refused += 1
            (diagnostic,) = error.diagnostics
            assert (diagnostic.code, diagnostic.help is None) == ("E0916", False)
    assert refused > 0.95 * len(places)


def test_a_checkpoint_waits_for_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "checkpoint.safetensors"
    found = waits_for_disk(monkeypatch, path)
    write_checkpoint(path, CHECKPOINT)
    assert found == [("file", b""), ("folder", path.read_bytes())]


def test_a_stage_that_goes_on_stands_where_it_stood() -> None:
    """One batch later nothing else has changed: what is forgotten would begin anew."""
    schedule = "schedule: {plateau: {patience: 9, factor: 0.5}}"
    program, spec = gain(f"  - {{epochs: 20, batch: 8, {schedule}}}\n")
    (plan,) = plan_stages(program, spec.train, Findings())
    runs = Runs(np.arange(64), np.ones(64, dtype=np.int64), 0, 65)
    engine = NoSteps()
    stage = StageRun(
        plan=plan,
        engine=cast("Any", engine),
        data=StageData(
            train=runs, train_rows=None, watched=runs, watched_rows=None, watched_set="train"
        ),
        starts=cast("Any", KnownStarts()),
        stop_asked=lambda: True,
        epoch_ended=lambda event: None,
    )
    stage.resume(PLACE)
    with pytest.raises(Interrupted):
        stage.run()
    place = stage.place()
    assert place is not None
    assert place.seconds >= PLACE.seconds
    assert_same(replace(place, seconds=PLACE.seconds), replace(PLACE, batch=4), "place")
    # the rate that was found, halved by each of the four reductions
    assert engine.began == [(11, 0.03125 / 16, 0, 0.75)]


def test_the_best_of_the_attempts_before_an_interruption_still_counts() -> None:
    program, spec = gain("  - {epochs: 2, starts: 2}\n")
    (plan,) = plan_stages(program, spec.train, Findings())
    opened: list[int] = []

    def attempt(number: int) -> StageRun:
        opened.append(number)
        worse = replace(result(9), attempt=number)
        return cast("Any", SimpleNamespace(attempt=number, run=lambda: worse))

    attempts = StageAttempts(plan, attempt, lambda run, fault: None)
    attempts.resume(replace(CHECKPOINT, attempt=1, leader=result(3), place=None))
    assert attempts.run() == result(3)
    assert opened == [0, 1]


@pytest.mark.parametrize("other", [5, 7])
def test_a_checkpoint_of_another_version_is_refused(
    other: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It may read well, and say something else."""
    path = tmp_path / "checkpoint.safetensors"
    with monkeypatch.context() as changed:
        changed.setattr(checkpoint, "_FORMAT", other)
        write_checkpoint(path, CHECKPOINT)
    with pytest.raises(SpecError, match="is not a checkpoint of this version"):
        read_checkpoint(path)

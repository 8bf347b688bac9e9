"""Rule R2: which rollouts an episode holds, so that none leaves it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from compiler.ir.nodes import Extent
from compiler.passes.close_loop import close_loop
from msnn.data.dataset import IntArray
from msnn.data.rollout_rows import Reach, reach, rollouts, rows_that_count
from msnn.simulation.rollout_plan import set_rollouts
from msnn.training.plans.stage_plan import plan_stages
from spec_schema.diagnostics.diagnostic import Findings
from tests.programs import fir_closed_loop, late_sensor, preview_driver, spring_damper_rk4
from tests.training.cases import compiled, dataset, in_blocks


def one(length: int, first: int = 0) -> IntArray:
    return np.array([[first, first + length]])


def test_an_episode_has_t_minus_a_minus_b_samples() -> None:
    runs = rollouts(one(10, first=100), Reach(3, 1, 0), 1, 1)
    assert runs.t0.tolist() == [103, 104, 105, 106, 107, 108]
    assert set(runs.steps.tolist()) == {1}


def test_starts_are_a_stride_apart_as_long_as_the_rows_exist() -> None:
    # t0−A … t0+N−1+B: 3 + 4 + 1 = 8 rows
    runs = rollouts(one(12), Reach(3, 1, 0), 4, 2)
    assert runs.t0.tolist() == [3, 5, 7]
    assert rollouts(one(8), Reach(3, 1, 0), 4, 1).t0.tolist() == [3]
    assert rollouts(one(7), Reach(3, 1, 0), 4, 1).t0.tolist() == []


def test_the_start_counts_only_at_t0() -> None:
    # an encoder reads t0 … t0+6, the steps one row ahead
    runs = rollouts(one(12), Reach(0, 1, 6), 2, 1)
    assert runs.t0.tolist() == [0, 1, 2, 3, 4, 5]
    assert Reach(0, 1, 6).rows(2) == 7


def test_the_rest_of_an_episode_has_a_start_only_where_that_can_be_read() -> None:
    # steps fit from 8 to 11 too, but the start at 8 would read row 14
    assert rollouts(one(12), Reach(0, 0, 6), 4, 4, rest=True).t0.tolist() == [0, 4]
    assert rollouts(one(12), Reach(0, 0, 3), 4, 4, rest=True).t0.tolist() == [0, 4, 8]
    runs = rollouts(one(12), Reach(0, 0, 2), 5, 5, rest=True)
    assert (runs.t0.tolist(), runs.steps.tolist()) == ([0, 5], [5, 5])
    runs = rollouts(one(12), Reach(0, 0, 1), 5, 5, rest=True)
    assert (runs.t0.tolist(), runs.steps.tolist()) == ([0, 5, 10], [5, 5, 2])


def test_an_episode_that_is_too_short_is_counted() -> None:
    episodes = np.array([[0, 20], [20, 25], [25, 40]])
    runs = rollouts(episodes, Reach(2, 1, 0), 4, 4)
    assert runs.skipped == 1
    assert runs.longest == 20
    assert runs.t0.tolist() == [2, 6, 10, 14, 27, 31, 35]


def test_a_last_shorter_rollout_covers_the_rest() -> None:
    runs = rollouts(one(12), Reach(1, 1, 0), 4, 4, rest=True)
    assert runs.t0.tolist() == [1, 5, 9]
    assert runs.steps.tolist() == [4, 4, 2]
    covered = [t for t0, n in zip(runs.t0, runs.steps, strict=True) for t in range(t0, t0 + n)]
    assert covered == list(range(1, 11))


def test_an_episode_as_horizon_has_one_start() -> None:
    episodes = np.array([[0, 10], [10, 12], [12, 30]])
    runs = rollouts(episodes, Reach(2, 1, 0), "episode", 1)
    assert runs.t0.tolist() == [2, 14]
    assert runs.steps.tolist() == [7, 15]
    assert runs.skipped == 1


def test_look_back_and_look_ahead_of_programs() -> None:
    assert reach(fir_closed_loop().program) == Reach(4, 1, 0)
    assert reach(spring_damper_rk4().program) == Reach(0, 1, 0)
    assert reach(preview_driver().program) == Reach(3, 3, 0)
    assert reach(late_sensor().program) == Reach(4, 0, 0)
    # what is predicted is compared with the log also where no loss reads it
    assert reach(replace(fir_closed_loop().program, losses=())) == Reach(4, 1, 0)
    closed = close_loop(fir_closed_loop().program, ("x",))
    assert reach(closed) == Reach(4, 1, 0)


@pytest.mark.parametrize(
    ("extent", "expected"),
    [
        (Extent(0, 0), range(4, 9)),
        (Extent(1, 1), range(3, 8)),
        (Extent(-1, 1), range(5, 8)),
        (Extent(0, 3), range(4, 6)),
        (Extent(-4, 0), range(8, 9)),
        (Extent(-3, 2), range(0)),
    ],
)
def test_an_evaluation_counts_where_its_whole_target_does(extent: Extent, expected: range) -> None:
    """A window of targets that ends in another set would score rows of that."""
    data = in_blocks(dataset({"u": np.zeros(12)}, train=[12]), "val", slice(4, 9))
    found = rows_that_count(data, "val", extent)
    assert np.flatnonzero(found).tolist() == list(expected)


@pytest.mark.parametrize(
    ("init", "spoiled"),
    [
        ("v.meas[t]", [0]),
        ("v.meas[t-2]", [2]),
        ("v.meas[t-2] + v.meas[t-1] + v.meas[t]", [0, 1, 2]),
        ("der(v.meas, method=forward)", [0, -1]),
    ],
)
def test_no_rollout_starts_from_a_missing_sample(init: str, spoiled: list[int]) -> None:
    """`spoiled` are the rows from a missing sample to the starts that read it."""
    text = """
msnn: 1
name: late
sample_time: 1 s
inputs: {u: 1}
targets: {v: 1}
states: {x: {next: "0.5*x + u", init: "INIT"}}
outputs: {y: {expr: x, predicts: "v[t]"}}
train: [{rollout: 3}]
"""
    program, spec = compiled(text.replace("INIT", init))
    series = {name: np.linspace(0.0, 1.0, 30) for name in ("u", "v")}
    missing = [9, 20]
    series["v"][missing] = np.nan
    findings = Findings()
    (plan,) = plan_stages(program, spec.train, findings)
    runs = set_rollouts(
        plan.rollout, dataset(series, train=[30]), "train", 1, "a test", None, findings
    )
    assert runs is not None
    back = reach(program).back
    never = {row + later for row in missing for later in spoiled}
    last = 30 - 3 - reach(program).ahead
    assert runs.t0.tolist() == [t0 for t0 in range(back, last + 1) if t0 not in never]


@pytest.mark.parametrize("horizon", ["episode", "record"])
def test_a_whole_episode_begins_where_its_start_is_measured(horizon: str) -> None:
    """One missing sample in its first row left the whole episode out, and nobody was told."""
    text = """
msnn: 1
name: late
sample_time: 1 s
inputs: {u: 1}
targets: {v: 1}
states: {x: {next: "0.5*x + u", init: "v.meas"}}
outputs: {y: {expr: x, predicts: "v[t]"}}
train: [{rollout: HORIZON}]
"""
    program, spec = compiled(text.replace("HORIZON", horizon))
    series = {name: np.linspace(0.0, 1.0, 30) for name in ("u", "v")}
    series["v"][[0, 1, *range(20, 30)]] = np.nan
    findings = Findings()
    (plan,) = plan_stages(program, spec.train, findings)
    data = dataset(series, train=[10, 10, 10])
    runs = set_rollouts(plan.rollout, data, "train", 1, "a test", None, findings)
    assert runs is not None
    assert runs.t0.tolist() == [2, 10]
    assert runs.steps.tolist() == [8, 10]
    series["v"][:] = np.nan
    data = dataset(series, train=[10, 10, 10])
    assert set_rollouts(plan.rollout, data, "train", 1, "a test", None, findings) is None
    found = findings.in_order[-1]
    assert found.message == "a test finds no row of `train` at which its states can start"


@pytest.mark.parametrize("horizon", [1, 3, 7])
@pytest.mark.parametrize("stride", [1, 2, 5])
def test_agrees_with_a_plain_search(horizon: int, stride: int) -> None:
    span = Reach(2, 1, 4)
    episodes = np.array([[0, 9], [9, 12], [12, 40], [40, 53]])
    expected = [
        t0
        for start, stop in episodes.tolist()
        for t0 in range(start + span.back, stop, stride)
        if max(t0 + horizon - 1 + span.ahead, t0 + span.start_ahead) < stop
    ]
    assert rollouts(episodes, span, horizon, stride).t0.tolist() == expected

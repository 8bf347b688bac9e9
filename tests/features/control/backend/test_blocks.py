"""Blocks in C: one control each, within the limits of all its samples, warm over the shift."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from msnn.features.control.backend import write_controller
from msnn.features.control.backend.library import (
    ControllerLibrary,
    Decision,
    multipliers_of,
    plan_of,
)
from msnn.features.control.backend.structure.rows import rows_of
from msnn.features.control.problem.horizon import Given, Multipliers
from msnn.features.control.problem.kkt import Judge
from msnn.features.control.problem.optimal_control import ControlProblem, Structure
from msnn.features.control.problem.trained import trained
from tests.conditions import require_tool
from tests.features.control.backend.built_controller import built_controller
from tests.features.control.specs import load

STRUCTURES: tuple[Structure, ...] = ("staged", "condensed")
SOLVED, INFEASIBLE, INPUT_NOT_FINITE = 0, 2, 3
BLOCKS = (1, 3, 4)
LOW = np.full(9, -1.0)
TEXT = """
msnn: 1
name: plant
sample_time: 0.1 s
inputs: {u: {between: hold}}
states: {x: {next: 1.05 * x + 0.1 * sin(x) + 0.2 * u, init: 0}}
outputs: {y: x}
mpc:
  horizon: 8
  controls: [u]
  references: {low: {preview: true}, top: {preview: true}}
  cost: {stage: (x - 1)**2 + 0.05 * u**2, terminal: 3 * (x - 1)**2}
  blocks: [1, 3, 4]
  bounds: {u: {min: low, max: LIMIT}}
"""


@dataclass(frozen=True)
class Built:
    """A controller that knows nothing yet."""

    problem: ControlProblem
    library: ControllerLibrary

    def multipliers(self) -> Multipliers:
        return multipliers_of(self.problem, rows_of(self.problem), self.library)

    def state(self, x: float, before: float = 0.0) -> np.ndarray:
        return np.array([x if m.name == "x" else before for m in self.problem.states.members])

    def controls(self) -> np.ndarray:
        return plan_of(self.problem, self.library).controls[:, 0]

    def solve(self, state: np.ndarray, top: np.ndarray, low: np.ndarray = LOW) -> Decision:
        return self.library.solve({"x": state, "top": top, "low": low})

    def residual(self, state: np.ndarray, top: np.ndarray, low: np.ndarray = LOW) -> float:
        """Of the last plan, by the interpreter."""
        given = Given(state, {}, {"top": top, "low": low})
        plan = plan_of(self.problem, self.library)
        return Judge(self.problem).residuals(given, plan, self.multipliers()).largest


def _built(folder: Path, structure: Structure, limit: str) -> Built:
    require_tool("gcc", install="apt install gcc")
    problem = load(folder, TEXT.replace("LIMIT", limit)).of(ControlProblem)
    assert problem is not None
    problem = trained(replace(problem, structure=structure), {})
    write_controller(problem, {}, folder / "c", prefix="plant", dtype="float64")
    return Built(problem, built_controller(folder / "c"))


@pytest.fixture(scope="module", params=STRUCTURES)
def shared(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Built:
    return _built(tmp_path_factory.mktemp("plant"), request.param, "top")


@pytest.fixture
def plant(shared: Built) -> Built:
    shared.library.init()
    return shared


def test_a_closed_loop_is_optimal_at_each_sample_and_warm(plant: Built) -> None:
    begins = np.cumsum((0, *BLOCKS[:-1]))
    x, u = -1.5, 0.0
    visited: list[tuple[np.ndarray, np.ndarray]] = []
    warm = anew = 0
    for t in range(12):
        top = 2 + np.sin(0.7 * np.arange(t, t + 9))
        state = plant.state(x, u)
        found = plant.solve(state, top)
        assert found.status == SOLVED
        controls = plant.controls()
        # to the bit: they are one number
        for begin, end in zip(begins, (*begins[1:], 8), strict=True):
            assert np.all(controls[begin:end] == controls[begin])
        assert plant.residual(state, top) <= 1.001e-6
        warm += found.iterations
        visited.append((state, top))
        u = float(found.control[0])
        x = 1.05 * x + 0.1 * np.sin(x) + 0.2 * u + 0.02 * (-1) ** t
    for state, top in visited:
        plant.library.init()
        anew += plant.solve(state, top).iterations
    # condensed plans are projected: there is little to be saved
    assert warm <= (0.8 * anew if plant.problem.structure == "staged" else anew)


@pytest.mark.parametrize("tight", range(8))
def test_the_tightest_sample_of_a_block_limits_it(plant: Built, tight: int) -> None:
    top = np.full(9, 2.0)
    top[tight] = -0.3
    assert plant.solve(plant.state(-2.0), top).status == SOLVED
    controls = plant.controls()
    block = np.searchsorted(np.cumsum(BLOCKS), tight, side="right")
    of_block = np.repeat(np.arange(3), BLOCKS) == block
    # the barrier leaves up to 1e-6 of slack times multiplier, and multipliers exceed 0.1
    assert controls[of_block] == pytest.approx(-0.3, abs=1e-5)
    assert np.all(controls[~of_block] > 0)
    held = plant.multipliers().control_max[:, 0]
    assert held[tight] > 0.1
    assert np.all(held[of_block & (np.arange(8) != tight)] == 0)


def test_limits_contradict_each_other_within_a_block_alone(plant: Built) -> None:
    """Behind the last control there is nothing that a limit could hold."""
    for stage, status in ((5, INFEASIBLE), (8, SOLVED), (0, INFEASIBLE)):
        top = np.full(9, 2.0)
        top[stage] = -1.5
        assert plant.solve(plant.state(0.5), top).status == status


def test_a_limit_without_room_takes_the_slope_of_its_block(plant: Built) -> None:
    for start, side in ((-2.0, "control_max"), (2.0, "control_min")):
        state, top, low = plant.state(start), np.full(9, 2.0), LOW.copy()
        # equal where they meet, at different samples
        top[6 if start < 0 else 5] = 0.1
        low[5 if start < 0 else 6] = 0.1
        for _ in range(2):
            assert plant.solve(state, top, low).status == SOLVED
            assert np.all(plant.controls()[4:] == 0.1)
            assert getattr(plant.multipliers(), side)[6, 0] > 0.01
            assert plant.residual(state, top, low) <= 1.001e-6


def test_the_next_solve_begins_at_the_means_of_blocks(plant: Built) -> None:
    plant.solve(plant.state(-1.0), np.full(9, 4.0))
    before = plant.controls()
    plant.library.prepare()
    later = np.append(before[1:], before[-1])
    own = [later[:1], later[1:4], later[4:]]
    wanted = np.concatenate([np.full(len(each), np.mean(each)) for each in own])
    # all are inside their limits
    assert plant.controls() == pytest.approx(wanted, rel=1e-12)
    if plant.problem.structure == "staged":
        place = plant.problem.states.member("u.history").first
        states = plan_of(plant.problem, plant.library).states
        assert np.all(states[1:, place] == plant.controls())


@pytest.mark.parametrize("structure", STRUCTURES)
def test_a_limit_that_is_no_number_holds_its_whole_block(
    structure: Structure, tmp_path: Path
) -> None:
    own = _built(tmp_path, structure, "sqrt(top)")
    top = np.full(9, 4.0)
    top[2] = -1.0
    found = own.solve(own.state(0.5), top)
    assert found.status == INPUT_NOT_FINITE
    assert found.control[0] == 0


def test_rounding_counts_all_samples_of_a_block_that_a_window_reads(tmp_path: Path) -> None:
    """Slopes that cancel out to 0, but whose terms round to more than the tolerance, are not known
    to be 0; a bound on them of one sample a stage called plans solved at 2.5 times that size."""
    require_tool("gcc", install="apt install gcc")
    samples, factor = 12, 8.0
    window = " + ".join(["u", *(f"u[t-{lag}]" for lag in range(1, samples))])
    cost = "(x - r)**2 + (w + r)**2"
    text = f"""
msnn: 1
name: plant
sample_time: 1 s
inputs: {{u: {{between: hold}}}}
states:
  x: {{next: "{factor} * ({window})", init: 0}}
  w: {{next: "{factor} * ({window})", init: 0}}
outputs: {{y: x}}
mpc:
  horizon: {samples}
  controls: [u]
  references: {{r: {{}}}}
  cost: {{stage: {cost}, terminal: {cost}}}
  blocks: [{samples}]
"""
    problem = load(tmp_path, text).of(ControlProblem)
    assert problem is not None
    problem = trained(replace(problem, structure="condensed"), {})
    write_controller(problem, {}, tmp_path / "c", prefix="plant", dtype="float64")
    library = built_controller(tmp_path / "c")
    state = np.zeros(problem.states.size)
    statuses: list[int] = []
    sizes = 10 ** np.arange(6, 8, 0.2)
    for r in sizes:
        library.init()
        found = library.solve({"x": state, "r": r})
        # 0 is the best: what one state wants is what the other does not
        assert found.control == pytest.approx(0, abs=1e-6)
        statuses.append(found.status)
    # of x and of w: a costate of 2 r times as many samples as were decided
    terms = 2 * sum(2 * sizes * factor * (k + 1) for k in range(samples)) * problem.cost_scale
    is_known = terms * np.finfo(float).eps / 2 <= problem.tolerance
    assert 0 < np.sum(is_known) < len(sizes)
    assert np.array_equal(np.array(statuses) == SOLVED, is_known)

"""What a controller says of a solve, and what it applies whatever it says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from msnn.features.control.run.method import Solver, Status
from tests.features.control.specs import DELAYED, DOUBLE_INTEGRATOR, controller, load, mpc

BOUNDS = "{u: {min: -2, max: 2, rate: 5}}"


def test_nan_is_never_solved_and_keeps_the_last_control(tmp_path: Path) -> None:
    own = controller(tmp_path, DOUBLE_INTEGRATOR + mpc(bounds=BOUNDS))
    before = own.solve({"p": 1.0, "v": 0.0})
    assert before.status is Status.SOLVED
    found = own.solve({"p": np.nan})
    assert found.status is Status.INPUT_NOT_FINITE
    assert found.control == before.control
    assert not found.residual <= 1e30
    again = own.solve({"p": 0.9, "v": -0.1})
    assert again.status is Status.SOLVED


def test_references_and_disturbances_that_are_not_finite(tmp_path: Path) -> None:
    text = DOUBLE_INTEGRATOR.replace("0.1 * u,", "0.1 * u + w,").replace("hold}}", "hold}, w: {}}")
    section = mpc(cost="(p - r)**2 + u**2", references="{r: {preview: true}}", preview="[w]")
    own = controller(tmp_path, text + section)
    good = {"references": {"r": np.ones(16)}, "disturbances": {"w": np.zeros(15)}}
    assert own.solve({"p": 0.0, "v": 0.0}, **good).status is Status.SOLVED
    for key, name, size in (("references", "r", 16), ("disturbances", "w", 15)):
        bad = np.zeros(size)
        bad[-1] = np.inf
        found = own.solve(**(good | {key: {name: bad}}))
        assert found.status is Status.INPUT_NOT_FINITE


def test_a_first_sample_that_is_not_finite_is_forgotten(tmp_path: Path) -> None:
    own = controller(tmp_path, DELAYED)
    for y, d, r in ((0.0, np.nan, 1.0), (np.nan, 0.0, 1.0), (0.0, 0.0, np.inf)):
        found = own.solve({"y": y}, references={"r": r}, disturbances={"d": d})
        assert found.status is Status.INPUT_NOT_FINITE
    again = own.solve({"y": 0.0}, references={"r": 1.0}, disturbances={"d": 0.0})
    assert again.status is Status.SOLVED
    own.reset()
    fresh = own.solve({"y": 0.0}, references={"r": 1.0}, disturbances={"d": 0.0})
    assert fresh.control == again.control


def test_a_reset_to_what_is_not_finite_is_refused(tmp_path: Path) -> None:
    """It once stayed in the memory: every later solve without that state had no input."""
    own, other = (controller(tmp_path, DOUBLE_INTEGRATOR + mpc()) for _ in range(2))
    for each in (own, other):
        each.solve({"p": 1.0, "v": 0.0})
    with pytest.raises(ValueError, match="`v` is nan: leave out what is not known"):
        own.reset({"p": 1.0, "v": np.nan})
    with pytest.raises(ValueError, match="`u` is inf"):
        own.reset(control={"u": np.inf})
    assert own.solve().control == other.solve().control


def test_what_is_not_measured_is_as_predicted_after_a_sample_that_is_none(tmp_path: Path) -> None:
    own, other = (controller(tmp_path, DOUBLE_INTEGRATOR + mpc()) for _ in range(2))
    for each in (own, other):
        each.solve({"p": 1.0, "v": 0.0})
    assert own.solve({"p": np.nan}).status is Status.INPUT_NOT_FINITE
    assert own.solve().states["p"][0] == other.solve().states["p"][0]


def test_a_plan_that_the_plant_does_not_follow_keeps_no_hard_limit(tmp_path: Path) -> None:
    own = controller(tmp_path, DELAYED)
    for y in (0.0, 0.3):
        own.solve({"y": y}, references={"r": 1.0}, disturbances={"d": 0.0})
    own.solve(references={"r": 1.0}, disturbances={"d": 0.0})
    found = own.solve({"y": 5.0}, references={"r": 1.0}, disturbances={"d": 0.0})
    assert found.status is Status.INFEASIBLE  # 0.9 * 5 + 0.05 * 5 - 1 is beyond 1.5 whatever u is
    assert found.violation > 1


def test_a_state_that_was_never_given(tmp_path: Path) -> None:
    own = controller(tmp_path, DOUBLE_INTEGRATOR + mpc(bounds="{u: {min: 1, max: 2}}"))
    found = own.solve({"p": 1.0})
    assert found.status is Status.NOT_INITIALISED
    assert found.control == {"u": 1.0}  # 0 is not among what it may be
    assert own.solve({"v": 0.0}).status is Status.SOLVED


def test_a_hard_bound_that_cannot_be_kept(tmp_path: Path) -> None:
    bounds = "{u: {min: -2, max: 2}, p: {max: 0.5, hard: true}}"
    own = controller(tmp_path, DOUBLE_INTEGRATOR + mpc(bounds=bounds))
    found = own.solve({"p": 2.0, "v": 1.0})
    assert found.status is Status.INFEASIBLE
    assert found.violation > 0.5
    assert np.abs(found.control["u"]) <= 2
    soft = controller(tmp_path, DOUBLE_INTEGRATOR + mpc(bounds=bounds.replace(", hard: true", "")))
    told = soft.solve({"p": 2.0, "v": 1.0})
    assert told.status is Status.SOLVED
    assert told.excess > 1
    assert told.control["u"] == pytest.approx(-2, abs=1e-6)


def test_limits_of_references_that_contradict_each_other(tmp_path: Path) -> None:
    bounds = "{u: {min: low, max: 1}}"
    section = mpc(bounds=bounds, references="{low: {}}")
    own = controller(tmp_path, DOUBLE_INTEGRATOR + section)
    found = own.solve({"p": 1.0, "v": 0.0}, references={"low": 2.0})
    assert found.status is Status.INFEASIBLE


@pytest.mark.parametrize("solver", ["c", "python"])
@pytest.mark.parametrize(
    ("references", "status"),
    [
        ({"top": -1.0}, Status.INPUT_NOT_FINITE),
        ({"soft": -1.0}, Status.INPUT_NOT_FINITE),
        ({"open": 0.0, "low": 0.0}, Status.INPUT_NOT_FINITE),
        ({"open": 0.0, "low": 1.0}, Status.INFEASIBLE),
        ({"low": 3.0}, Status.INFEASIBLE),
    ],
)
def test_limits_that_no_number_meets(
    references: dict[str, float], status: Status, solver: Solver, tmp_path: Path
) -> None:
    bounds = "{u: {min: low / open, max: sqrt(top)}, p: {max: sqrt(soft)}}"
    section = mpc(bounds=bounds, references="{low: {}, open: {}, top: {}, soft: {}}")
    own = controller(tmp_path, DOUBLE_INTEGRATOR + section, solver)
    known = {"low": -2.0, "open": 1.0, "top": 4.0, "soft": 9.0}
    found = own.solve({"p": 1.0, "v": 0.0}, references=known | references)
    assert found.status is status
    # 3 is above 2: of limits that contradict each other the upper one is kept
    assert found.control["u"] == (2 if references == {"low": 3.0} else 0)
    before = own.solve({"p": -3.0, "v": 0.0}, references=known)
    assert before.status is Status.SOLVED
    assert before.control["u"] > 1
    again = own.solve({"p": -3.0}, references=known | references)
    assert again.control["u"] == pytest.approx(before.control["u"], abs=1e-6)
    # what is held is within the limits of now
    held = own.solve({"p": np.nan}, references=known | {"top": 0.25})
    assert held.status is Status.INPUT_NOT_FINITE
    assert held.control["u"] == 0.5
    assert own.solve({"p": np.nan}, references=known).control["u"] == 0.5


def test_a_rate_that_cannot_reach_the_limits(tmp_path: Path) -> None:
    section = mpc(bounds="{u: {min: 1, max: 2, rate: 1}}")
    own = controller(tmp_path, DOUBLE_INTEGRATOR + section)
    found = own.solve({"p": 1.0, "v": 0.0, "u.history": [0.0]})
    assert found.status is Status.INFEASIBLE


def test_iterations_that_run_out(tmp_path: Path) -> None:
    bounds = "{u: {min: -2, max: 2}}"
    section = mpc(bounds=bounds, solver="{interior_point: {iterations: 2}}")
    found = controller(tmp_path, DOUBLE_INTEGRATOR + section).solve({"p": 3.0, "v": 0.0})
    assert found.status is Status.CAPPED
    assert found.residual > 1e-6
    assert found.iterations == 2


@pytest.mark.parametrize("solver", ["c", "python"])
def test_fixed_iterations_are_at_most_so_many(solver: Solver, tmp_path: Path) -> None:
    """Also where a plan had to be begun anew; a problem that is solved needs no more."""
    section = mpc(bounds=BOUNDS, solver="{interior_point: {mode: fixed, iterations: 9}}")
    own = controller(tmp_path, DOUBLE_INTEGRATOR + section, solver)
    found = [own.solve({"p": (-1.0) ** k, "v": 0.1 * k}) for k in range(6)]
    found += [own.solve() for _ in range(6)]
    assert max(each.iterations for each in found) == 9
    assert {each.status for each in found} == {Status.SOLVED, Status.CAPPED}
    for each in found:
        assert (each.status is Status.SOLVED) == (each.residual <= 1e-6)


@pytest.mark.parametrize(
    "keys",
    [
        {"horizon": "1"},
        {"bounds": "{u: {min: 0.5, max: 0.5}}"},
        {"cost": "p**2 + 0 * u**2"},
        {"bounds": "{p: {min: -0.1, max: -0.1}}"},
        {"blocks": "[1, 2, 12]", "bounds": BOUNDS},
        {"hessian": "gauss_newton", "bounds": BOUNDS},
    ],
    ids=lambda keys: next(iter(keys)),
)
def test_odd_problems_are_solved(keys: dict[str, str], tmp_path: Path) -> None:
    own = controller(tmp_path, DOUBLE_INTEGRATOR + mpc(**keys))
    found = own.solve({"p": 1.0, "v": 0.0})
    assert found.status is Status.SOLVED
    assert own.residuals(found).largest <= 1.001e-6
    if "blocks" in keys:
        assert len(set(found.controls["u"].tolist())) == 3


def test_control_starts_from_what_is_applied(tmp_path: Path) -> None:
    own = controller(tmp_path, DOUBLE_INTEGRATOR + mpc(bounds=BOUNDS))
    own.reset({"p": 1.0, "v": 0.0}, control={"u": 2.0})
    assert own.solve().control["u"] == pytest.approx(1.5, abs=1e-7)  # 5/s over 0.1 s


def test_wrong_names_and_shapes(tmp_path: Path) -> None:
    own = controller(tmp_path, DOUBLE_INTEGRATOR + mpc())
    with pytest.raises(ValueError, match="no state or fed-back signal `q`"):
        own.solve({"q": 1.0})
    with pytest.raises(ValueError, match="`p` has shape"):
        own.solve({"p": [1.0, 2.0]})
    with pytest.raises(ValueError, match="references wanted for"):
        own.solve({"p": 1.0, "v": 0.0}, references={"r": 1.0})


def test_a_model_without_the_section(tmp_path: Path) -> None:
    import msnn

    with pytest.raises(ValueError, match="has no `mpc` section"):
        msnn.mpc(load(tmp_path, DOUBLE_INTEGRATOR))

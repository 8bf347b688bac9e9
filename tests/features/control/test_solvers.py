"""The exported C and the reference in Python say the same of the same problems."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import msnn
from msnn.features.control.run.method import Status
from spec_schema.diagnostics.diagnostic import SpecError
from tests.conditions import require_tool
from tests.features.control.specs import DOUBLE_INTEGRATOR, controller, load, mpc

LIMITS = "{u: {min: -2, max: 2, rate: 5}}"
HARD = "{u: {min: -2, max: 2}, p: {max: 0.5, hard: true}}"
CASES: dict[str, tuple[dict[str, str], list[dict[str, Any]]]] = {
    "cold and warm": ({"bounds": LIMITS}, [{"p": 1.0, "v": 0.0}, {}, {"p": 0.98, "v": -0.1}, {}]),
    "not a number": (
        {"bounds": LIMITS},
        [{"p": np.nan, "v": 0.0}, {"p": 1.0}, {"v": np.inf}, {"p": 1.0, "v": 0.0}],
    ),
    "not initialised": ({"bounds": LIMITS}, [{"p": 1.0}, {"v": 0.0}, {}]),
    "infeasible and again": (
        {"bounds": HARD},
        [{"p": 2.0, "v": 1.0}, {"p": 0.3, "v": 0.0}, {"p": 5.0}, {"p": 0.3, "v": 0.0}],
    ),
    "infeasible when capped": (
        {"bounds": HARD, "solver": "{interior_point: {iterations: 3}}"},
        [{"p": 2.0, "v": 1.0}, {}],
    ),
    "capped": (
        {"bounds": LIMITS, "solver": "{interior_point: {iterations: 1}}"},
        [{"p": 3.0, "v": 0.0}, {"p": -3.0}],
    ),
    "exceeded": ({"bounds": HARD.replace(", hard: true", "")}, [{"p": 2.0, "v": 1.0}, {}]),
    "gauss_newton": (
        {"bounds": LIMITS, "hessian": "gauss_newton"},
        [{"p": 1.0, "v": 0.0}, {"p": -1.0}],
    ),
    "a reference moves the limit": (
        {"bounds": "{u: {min: low, max: 1}}", "references": "{low: {preview: true}}"},
        [{"p": 1.0, "v": 0.0, "low": 0.5}, {"low": 2.0}, {"low": -1.0}],
    ),
}


def _asked(calls: list[dict[str, Any]]) -> Iterator[tuple[Mapping[str, float], dict[str, Any]]]:
    for call in calls:
        x = {name: value for name, value in call.items() if name != "low"}
        references = {"low": np.linspace(call["low"], 0.0, 16)} if "low" in call else {}
        yield x, references


@pytest.mark.parametrize("name", CASES)
def test_statuses_and_optima_are_those_of_the_reference(name: str, tmp_path: Path) -> None:
    require_tool("gcc", install="apt-get install gcc")
    keys, calls = CASES[name]
    text = DOUBLE_INTEGRATOR + mpc(**keys)
    compiled, reference = (controller(tmp_path, text, solver) for solver in ("c", "python"))
    assert (compiled.solver, reference.solver) == ("c", "python")
    for x, references in _asked(calls):
        own = compiled.solve(x, references=references)
        other = reference.solve(x, references=references)
        assert own.status == other.status
        if own.status is Status.SOLVED:
            # 1e-7 for sums of another order
            assert compiled.residuals(own).largest <= 1.1e-6
            assert reference.residuals(own).largest <= 1.1e-6
            assert own.cost == pytest.approx(other.cost, rel=1e-6, abs=1e-6)
            # half a weight of 0.1 makes a gradient of 1e-6 a distance of 1e-5 and less
            assert own.control["u"] == pytest.approx(other.control["u"], abs=2e-5)
            assert own.excess == pytest.approx(other.excess, abs=2e-5)
        elif own.status is not Status.CAPPED:  # held by both, from controls alike
            assert own.control["u"] == pytest.approx(other.control["u"], abs=2e-5)
            assert (own.plan, own.given) == (None, None)


def test_a_plan_that_breaks_what_must_hold_is_never_applied(tmp_path: Path) -> None:
    """The C called it capped where iterations ran out, and moved the control by it."""
    require_tool("gcc", install="apt-get install gcc")
    text = DOUBLE_INTEGRATOR + mpc(bounds=HARD)
    for iterations in (1, 2, 5, 20):
        section = f"  solver: {{interior_point: {{iterations: {iterations}}}}}\n"
        own = controller(tmp_path, text + section, "c")
        own.reset({"p": 2.0, "v": 1.0}, control={"u": 0.25})
        found = own.solve()
        assert found.status is Status.INFEASIBLE
        assert found.violation > 0.5
        assert found.control["u"] == 0.25


def test_the_first_move_is_from_what_is_applied(tmp_path: Path) -> None:
    require_tool("gcc", install="apt-get install gcc")
    own = controller(tmp_path, DOUBLE_INTEGRATOR + mpc(bounds=LIMITS), "c")
    own.reset({"p": 1.0, "v": 0.0}, control={"u": 2.0})
    first = own.solve()
    assert first.control["u"] == pytest.approx(1.5, abs=1e-7)  # 5/s over 0.1 s
    own.reset({"p": 1.0, "v": 0.0}, control={"u": 2.0})
    again = own.solve()
    assert again.plan is not None
    assert first.plan is not None
    assert again.plan.controls.tobytes() == first.plan.controls.tobytes()


def test_without_a_compiler_python_solves_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    model = load(tmp_path, DOUBLE_INTEGRATOR + mpc(bounds=LIMITS))
    with pytest.warns(RuntimeWarning, match="W1120"):
        own = msnn.mpc(model)
    assert own.solver == "python"
    assert own.solve({"p": 1.0, "v": 0.0}).status is Status.SOLVED
    with pytest.raises(SpecError, match="E1144"):
        msnn.mpc(model, solver="c")
    assert msnn.mpc(model, solver="python").solver == "python"

"""Plants, costs and limits without values beyond some state: a first plan leads there.

At rest a tank runs empty, and the root of what is below 0 is NaN; a plan with a stage without
values led every sample to INFEASIBLE. C and the reference in Python begin such plans at what was
measured.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from msnn.features.control.backend import write_controller
from msnn.features.control.backend.write_controller import controller_texts
from msnn.features.control.problem.optimal_control import ControlProblem
from msnn.features.control.run.method import Solver, Status
from tests.conditions import require_tool
from tests.features.control.backend.built_controller import built_controller
from tests.features.control.specs import controller, load

HORIZON = 20
TO_FOUR = '{stage: "(x - 4)**2 + 0.05 * u**2", terminal: "5 * (x - 4)**2"}'


def plant(
    states: dict[str, str],
    cost: str = TO_FOUR,
    bounds: str = "u: {min: 0, max: 10}",
    *,
    inputs: str = "u: {between: hold}",
    outputs: str = "",
    more: str = "",
    solver: str = "",
) -> str:
    lines = "\n".join(f'  {k}: {{next: "{v}", init: {k}.meas}}' for k, v in states.items())
    return (
        f"msnn: 1\nname: ends\nsample_time: 0.1 s\ninputs: {{{inputs}}}\nstates:\n{lines}\n"
        f"outputs: {{seen: 1 * {next(iter(states))}{outputs}}}\n"
        f"mpc:\n  horizon: {HORIZON}\n  controls: [u]\n  cost: {cost}\n  bounds: {{{bounds}}}\n"
        f"{more}  solver: {{interior_point: {{structure: STRUCTURE{solver}}}}}\n"
    )


ROOT = "x + 0.3 * u - 0.4 * sqrt(x)"
PLANTS: dict[str, tuple[str, tuple[dict[str, float], ...]]] = {
    "root": (plant({"x": ROOT}), ({"x": 1.0}, {"x": 9.0})),
    "root_with_hard_limits": (
        plant({"x": ROOT}, bounds="u: {min: 0, max: 10}, x: {min: 0.5, max: 5, hard: true}"),
        ({"x": 0.7}, {"x": 4.9}),
    ),
    "root_in_blocks_with_a_rate": (
        plant(
            {"x": ROOT},
            '{stage: "(x - 4)**2 + 0.05 * (u - u[t-1])**2", terminal: "5 * (x - 4)**2"}',
            "u: {min: 0, max: 10, rate: 20}",
            more="  blocks: [1, 1, 2, 4, 12]\n",
        ),
        ({"x": 2.0}, {"x": 9.0}),
    ),
    "root_with_a_preview": (
        plant(
            {"x": "x + 0.3 * u - 0.4 * sqrt(x - w)"},
            inputs="u: {between: hold}, w: {}",
            more="  preview: [w]\n",
        ),
        ({"x": 1.0}, {"x": 9.0}),
    ),
    "one_state_of_two": (
        plant(
            {"a": "a + 0.3 * u - 0.4 * sqrt(a)", "p": "0.9 * p + 0.1 * (a - 2)"},
            '{stage: "p**2 + (a - 2)**2 + 0.05 * u**2", terminal: "5 * p**2"}',
        ),
        ({"a": 0.3, "p": 2.0}, {"a": 4.0, "p": -1.0}),
    ),
    "power": (plant({"x": "x + 0.3 * u - 0.4 * x**0.6"}), ({"x": 1.0}, {"x": 9.0})),
    "logarithm": (
        plant({"x": "x + 0.1 * u - 0.2 + 0.01 * log(x)"}),
        ({"x": 0.5}, {"x": 1.0}),
    ),
    # with 1 / x alone a plan could step over the pole, to another minimum
    "quotient": (
        plant(
            {"x": "x + 0.25 * u - 0.25", "y": "y + 0.1 * (1 / max(x, 0) - y)"},
            '{stage: "(x - 2)**2 + 0.1 * y**2 + 0.05 * u**2", terminal: "5 * (x - 2)**2"}',
        ),
        ({"x": 1.0, "y": 0.0}, {"x": 3.0, "y": 0.5}),
    ),
    "arc_sine": (
        plant(
            {"q": "q + 0.1 * w", "w": "w + 0.1 * (3 * asin(q) + 4 * u)"},
            '{stage: "q**2 + 0.05 * u**2", terminal: "5 * q**2 + w**2"}',
            "u: {min: -2, max: 2}",
        ),
        ({"q": 0.6, "w": 0.0}, {"q": -0.7, "w": 0.0}),
    ),
    "cost": (
        plant(
            {"x": "x + 0.3 * u - 0.3"},
            '{stage: "log(x)**2 + 0.05 * u**2", terminal: "5 * log(x)**2"}',
        ),
        ({"x": 0.5}, {"x": 4.0}),
    ),
    "terminal_cost": (
        plant({"x": "x + 0.1 * u - 0.1"}, '{stage: 0.05 * u**2, terminal: "5 * log(x)**2"}'),
        ({"x": 0.5}, {"x": 1.95}),
    ),
    "limit": (
        plant(
            {"x": "x + 0.3 * u - 0.3"},
            TO_FOUR.replace("4", "3"),
            "u: {min: 0, max: 10}, g: {min: -0.5}",
            outputs=", g: log(x)",
        ),
        ({"x": 0.5}, {"x": 4.0}),
    ),
    # exp(x) is infinite beyond 710: the plant runs away at rest
    "overflow": (
        plant(
            {"x": "x + 0.2 * (exp(x) - 1 + 2 * u)"},
            '{stage: "x**2 + 0.05 * u**2", terminal: "5 * x**2"}',
            "u: {min: -5, max: 5}",
        ),
        ({"x": 1.0}, {"x": 1.5}),
    ),
}


@pytest.mark.parametrize("structure", ["staged", "condensed"])
@pytest.mark.parametrize("name", PLANTS)
def test_a_plan_that_leads_beyond_all_values_is_begun_anew(
    name: str, structure: str, tmp_path: Path
) -> None:
    """A loop of C beside the reference, the first sample and a jump after good plans included."""
    require_tool("gcc", install="apt install gcc")
    text, starts = PLANTS[name]
    own, other = (
        controller(tmp_path, text.replace("STRUCTURE", structure), solver)
        for solver in ("c", "python")
    )
    for start in starts:
        own.reset()
        other.reset()
        state = start
        for t in range(5):
            state = starts[0] if t == 3 else state
            known = {}
            if "preview" in name:
                known = {"disturbances": {"w": np.full(HORIZON, 0.5 * (t % 2))}}
            found, wanted = own.solve(state, **known), other.solve(state, **known)
            assert (found.status, wanted.status) == (Status.SOLVED, Status.SOLVED)
            # either ends at some point within the tolerance; the cost is flat there
            assert found.cost == pytest.approx(wanted.cost, rel=1e-5, abs=1e-6)
            np.testing.assert_allclose(found.controls["u"], wanted.controls["u"], atol=5e-3)
            state = {k: float(np.ravel(wanted.states[k])[1]) for k in state}


@pytest.mark.parametrize("structure", ["staged", "condensed"])
@pytest.mark.parametrize("name", ["root", "arc_sine", "cost", "limit", "overflow"])
def test_single_precision_begins_anew_too(name: str, structure: str, tmp_path: Path) -> None:
    require_tool("gcc", install="apt install gcc")
    text, starts = PLANTS[name]
    text = text.replace("STRUCTURE", structure)
    problem = load(tmp_path, text).of(ControlProblem)
    assert problem is not None
    write_controller(problem, {}, tmp_path / "c", prefix="ends", dtype="float32")
    own, other = built_controller(tmp_path / "c"), controller(tmp_path, text, "python")
    for start in starts:
        own.init()
        found, wanted = own.solve({"x": list(start.values())}), other.solve(start)
        assert found.status == Status.SOLVED
        # single precision has the tolerance 1e-3
        assert found.control[0] == pytest.approx(float(wanted.control["u"]), abs=0.1)
        other.reset()


@pytest.mark.parametrize("structure", ["staged", "condensed"])
@pytest.mark.parametrize("solver", ["c", "python"])
def test_a_plan_that_ends_without_values_is_no_sample_lost(
    solver: Solver, structure: str, tmp_path: Path
) -> None:
    """The last state of a plan has no next one: a sample later it has, and that is NaN."""
    if solver == "c":
        require_tool("gcc", install="apt install gcc")
    text = plant(
        {"x": ROOT},
        '{stage: 0.1 * u**2, terminal: "5 * (x + 1)**2"}',
        solver=", mode: fixed, iterations: 8",
    )
    own = controller(tmp_path, text.replace("STRUCTURE", structure), solver)
    level = 3.0
    for _ in range(6):
        found = own.solve({"x": level})
        assert found.status <= Status.CAPPED
        assert found.iterations <= 8
        level += 0.3 * float(found.control["u"]) - 0.4 * np.sqrt(level)


FINITE = {
    "linear": {"x": "0.9 * x + 0.1 * u"},
    "bilinear": {"x": "0.9 * x + 0.1 * u * x"},
    "guarded_root": {"x": "x + 0.3 * u - 0.4 * sqrt(max(x, 0.1))"},
    "root_of_a_square": {"x": "x + 0.3 * u - 0.4 * sqrt(x * x + 1)"},
    "quotient_by_a_positive_number": {"x": "x + u / (1 + x * x)"},
    "guarded_power": {"x": "x + 0.3 * u - 0.4 * max(x, 0)**0.6"},
    "bounded": {"x": "x + tanh(x + u) + atan(x) * sin(u) + softplus(-x)"},
}
ENDING = {
    "quotient": {"x": "x + 0.1 * u / x"},
    "quotient_by_a_wave": {"x": "x + 0.1 * u / cos(x)"},
    "root": {"x": "x + 0.3 * u - 0.4 * sqrt(x)"},
    "arc_cosine": {"x": "x + 0.3 * u - 0.4 * acos(x)"},
    "exponential": {"x": "x + 0.1 * (exp(x) + u)"},
    "root_of_a_previewed_number": {"x": "x + 0.3 * u - 0.4 * sqrt(w)"},
}


@pytest.mark.parametrize("structure", ["staged", "condensed"])
@pytest.mark.parametrize("name", [*FINITE, *ENDING])
def test_only_a_plant_that_can_end_is_looked_after(
    name: str, structure: str, tmp_path: Path
) -> None:
    states = FINITE.get(name) or ENDING[name]
    inputs = "u: {between: hold}"
    is_previewed = "previewed" in name
    text = plant(
        states,
        inputs=inputs + (", w: {}" if is_previewed else ""),
        more="  preview: [w]\n" if is_previewed else "",
    )
    problem = load(tmp_path, text.replace("STRUCTURE", structure)).of(ControlProblem)
    assert problem is not None
    source = controller_texts(problem, "ends", "float64")["src/ends_mpc.c"]
    assert bool(re.search(r"is_followed\(", source)) == (name in ENDING)

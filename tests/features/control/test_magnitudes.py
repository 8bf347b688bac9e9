"""What is called solved is optimal, whatever the size of what was measured or is wanted."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from msnn.features.control.backend.inputs import input_fields
from msnn.features.control.backend.library import multipliers_of, plan_of
from msnn.features.control.backend.structure.rows import rows_of
from msnn.features.control.backend.write_controller import write_controller
from msnn.features.control.problem.horizon import Given
from msnn.features.control.problem.kkt import Judge
from msnn.features.control.problem.optimal_control import ControlProblem
from msnn.features.control.problem.structure import Chosen
from msnn.features.control.problem.trained import trained
from msnn.features.control.run.method import Status
from tests.conditions import require_tool
from tests.features.control.backend.built_controller import built_controller
from tests.features.control.specs import (
    DOUBLE_INTEGRATOR,
    WINDOW_AND_NO_WEIGHT,
    controller,
    load,
    mpc,
)

TANK = """
msnn: 1
name: tank
sample_time: 4 s
inputs: {pump: {between: hold}, leak: {between: hold}}
states:
  upper: {next: "upper + 0.12 * pump - 0.3 * sqrt(max(upper, 0.1))", init: 0, range: [0, 15]}
  lower:
    next: lower + 0.3 * sqrt(max(upper, 0.1)) - 0.3 * sqrt(max(lower, 0.1)) - leak
    init: 0
    range: [0, 15]
outputs: {level: 1 * lower}
mpc:
  horizon: 10
  controls: [pump]
  references: {wanted: {}}
  cost: {stage: (lower - wanted)**2 + 0.1 * pump**2, terminal: 10 * (lower - wanted)**2}
  bounds: {pump: {min: 0, max: 10}, upper: {max: 11}}
"""
"""One level above its soft limit, far enough, once ended as solved by rounding alone."""

FILTER = "msnn: 1\nname: filter\nsample_time: 1 s\n" + WINDOW_AND_NO_WEIGHT

SOFT = DOUBLE_INTEGRATOR + mpc(
    bounds="{u: {min: -2, max: 2, rate: 5}, p: {max: 0.5}}",
    references="{r: {}}",
    cost="{stage: 4 * (p - r)**2 + v**2 + 0.1 * u**2, terminal: 20 * p**2 + 5 * v**2}",
)
PLANTS = {"tank": TANK, "filter": FILTER, "soft": SOFT}
EXPONENTS = (-30, -8, -2, 0, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 16, 20, 30, 38, 60, 150, 200, 300)


def _drawn(problem: ControlProblem) -> Iterator[tuple[np.ndarray, dict[str, float]]]:
    """Each number that is measured, given or wanted at each magnitude, the others ordinary."""
    known = [*problem.disturbances.members, *problem.references.members]
    names = [member.name for member in known]
    places = [*range(problem.states.size), *names]
    for place, exponent, sign in itertools.product(places, EXPONENTS, (1, -1)):
        x, values = np.full(problem.states.size, 0.3), dict.fromkeys(names, 0.2)
        if isinstance(place, int):
            x[place] = sign * 10.0**exponent
        else:
            values[place] = sign * 10.0**exponent
        yield x, values


def _given(problem: ControlProblem, x: np.ndarray, values: dict[str, float]) -> Given:
    along = {name: np.full(problem.horizon + 1, value) for name, value in values.items()}
    disturbances = [member.name for member in problem.disturbances.members]
    return Given(
        x,
        {name: along[name] for name in disturbances},
        {name: array for name, array in along.items() if name not in disturbances},
    )


@pytest.mark.parametrize("name", PLANTS)
@pytest.mark.parametrize("structure", ["staged", "condensed"])
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_what_the_c_calls_solved_is_optimal_at_any_magnitude(
    name: str, structure: Chosen, dtype: Literal["float32", "float64"], tmp_path: Path
) -> None:
    require_tool("gcc", install="apt install gcc")
    problem = load(tmp_path, PLANTS[name]).of(ControlProblem)
    assert problem is not None
    tolerance = 1e-6 if dtype == "float64" else 1e-3
    problem = replace(problem, structure=structure, tolerance=tolerance)
    weights = {p.name: np.full([a.size for a in p.axes], 0.1) for p in problem.program.parameters}
    out = tmp_path / "out"
    write_controller(problem, weights, out, prefix="plant", dtype=dtype)
    library = built_controller(out)
    problem = trained(problem, weights)
    judge, rows, real = Judge(problem), rows_of(problem), np.dtype(dtype).type
    fields = {field.name: field.identifier for field in input_fields(problem)}
    solved = 0
    for x, values in _drawn(problem):
        with np.errstate(over="ignore", under="ignore"):
            # what the controller is given: beyond single precision there are ∞ and 0
            x = x.astype(real).astype(np.float64)
            values = {n: float(real(value)) for n, value in values.items()}
        if not np.all(np.isfinite([*x, *values.values()])):
            continue
        library.init()
        decision = library.solve({"x": x, **{fields[n]: v for n, v in values.items()}})
        if decision.status != Status.SOLVED:
            continue
        solved += 1
        assert decision.residual <= tolerance
        plan, multipliers = plan_of(problem, library), multipliers_of(problem, rows, library)
        found = judge.residuals(_given(problem, x, values), plan, multipliers)
        # the judge rounds too: twice
        assert found.largest <= 2 * tolerance, (x, values, found)
    # ordinary numbers, and all that are next to nothing, are solved
    assert solved >= 4


@pytest.mark.parametrize(("place", "size"), [("upper", 1e30), ("upper", 1e8), ("wanted", 1e16)])
def test_what_python_calls_solved_is_optimal_far_from_all_scales(
    place: str, size: float, tmp_path: Path
) -> None:
    own = controller(tmp_path, TANK, "python")
    values = {"upper": 5.0, "lower": 5.0, "leak": 0.0, "wanted": 6.0} | {place: size}
    x = {name: values[name] for name in ("upper", "lower")}
    found = own.solve(
        x, references={"wanted": values["wanted"]}, disturbances={"leak": values["leak"]}
    )
    if found.status is Status.SOLVED:
        assert own.residuals(found).largest <= 2e-6
    else:
        assert not found.residual <= 1e-6


APART = """
msnn: 1
name: apart
sample_time: 1 s
inputs: {u: {between: hold}}
states:
  x: {next: 0.9 * x + 0.2 * u, init: 0}
  w: {next: 0.9 * w, init: 0}
outputs: {y: x + w}
mpc:
  horizon: 20
  controls: [u]
  cost: {stage: x**2 + w**2 + 0.1 * u**2, terminal: x**2}
  bounds: {u: {min: -2, max: 2}}
  solver: {interior_point: {structure: condensed}}
"""


def test_what_no_control_moves_does_not_round_slopes_in_controls(tmp_path: Path) -> None:
    """Costates of 1e10 beside slopes that have none of them: optimal, and to be called so."""
    require_tool("gcc", install="apt install gcc")
    problem = load(tmp_path, APART).of(ControlProblem)
    assert problem is not None
    write_controller(problem, {}, tmp_path / "out", prefix="plant", dtype="float64")
    library = built_controller(tmp_path / "out")
    controls: list[float] = []
    for w in (0.0, 1e9):
        library.init()
        decision = library.solve({"x": np.array([1.0, w])})
        assert decision.status == Status.SOLVED
        controls.append(float(decision.control[0]))
    assert controls[1] == pytest.approx(controls[0], abs=1e-6)

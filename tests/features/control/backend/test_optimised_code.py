"""Code that a compiler makes faster decides as the code that it leaves as it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from backends.c.host.build import build_library
from msnn.features.control.backend import write_controller
from msnn.features.control.backend.library import ControllerLibrary
from msnn.features.control.problem.optimal_control import ControlProblem
from tests.conditions import require_tool
from tests.features.control.specs import load

SOLVED = 0


def _text(controls: int, hessian: str) -> str:
    """One state with a soft limit, controls with limits of their own: all sizes are small, so that
    a compiler makes vectors of whole loops."""
    names = [f"u{i}" for i in range(controls)]
    moved = " + ".join(f"{0.5 / (i + 1):.3f} * {name}" for i, name in enumerate(names))
    return "\n".join(
        (
            "msnn: 1\nname: small\nsample_time: 1 s",
            f"inputs: {{{', '.join(f'{name}: {{between: hold}}' for name in names)}}}",
            f'states: {{x: {{next: "0.97 * x + {moved}", init: 0}}}}',
            "outputs: {y: 1 * x}",
            "mpc:",
            "  horizon: 10",
            f"  controls: [{', '.join(names)}]",
            f"  hessian: {hessian}",
            "  references: {q: {}, r: {}, top: {}, low: {}, high: {}}",
            "  cost:",
            f'    stage: "q * (x - r)**2 + 0.1 * ({" + ".join(f"{name}**2" for name in names)})"',
            '    terminal: "(x - r)**2"',
            "  bounds:",
            *(f"    {name}: {{min: low, max: high}}" for name in names),
            "    x: {max: top}",
        )
    )


@pytest.mark.parametrize(
    ("controls", "hessian"), [(1, "gauss_newton"), (2, "gauss_newton"), (3, "exact"), (2, "exact")]
)
def test_small_controllers_are_the_same_at_all_levels(
    controls: int, hessian: str, tmp_path: Path
) -> None:
    """gcc 12 at -O2 made a wrong step of two controls and one state: no problem was solved."""
    require_tool("gcc", install="apt install gcc")
    problem = load(tmp_path, _text(controls, hessian)).of(ControlProblem)
    assert problem is not None
    out = tmp_path / "c"
    write_controller(problem, {}, out, prefix="small", dtype="float64")
    found: list[bytes] = []
    for level in ("-O0", "-O2", "-O3"):
        path = build_library(out, tmp_path / f"small{level}.so", ["gcc"], (level,))
        library = ControllerLibrary.of_folder(out, path)
        given = {"q": 1.0, "r": 0.3, "top": 0.5, "low": -1.0, "high": 1.0}
        plans = b""
        for x in (1.0, -3.0, 0.2):
            decision = library.solve({"x": np.array([x]), **given})
            assert decision.status == SOLVED
            plans += library.member("z").tobytes()
        found.append(plans)
    assert found[1:] == found[:1] * 2

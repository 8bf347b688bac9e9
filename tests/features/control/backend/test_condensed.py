"""Controllers in the controls alone: windows of all kinds, the same plans as stage by stage."""

from __future__ import annotations

import itertools
import re
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from backends.c_language.literals import Dtype
from msnn.features.control.backend import write_controller
from msnn.features.control.backend.inputs import input_fields
from msnn.features.control.backend.library import ControllerLibrary
from msnn.features.control.export.judged_controller import compare_controller
from msnn.features.control.problem.optimal_control import ControlProblem, Structure
from msnn.features.control.problem.trained import trained
from tests.conditions import require_tool
from tests.features.control.backend.built_controller import built_controller
from tests.features.control.specs import load

DTYPES: tuple[Dtype, ...] = ("float64", "float32")
START = "msnn: 1\nname: plant\nsample_time: 0.1 s\n"
PLANTS = {
    "filter_without_states": """
inputs: {u: {between: hold}}
layers: {h: {fir: {window: 5, init: 0.3}}}
outputs: {y: h(u)}
mpc:
  horizon: 8
  controls: [u]
  references: {r: {preview: true}}
  cost: {stage: (y - r)**2 + 1e-3 * u**2}
  bounds: {u: {min: -1, max: 1}, y: {max: 0.9}}
""",
    "filter_and_rates": """
inputs: {u: {between: hold}, d: {between: hold}, v: {between: hold}}
layers: {h: {fir: {window: 12, init: 0.05}}}
states: {x: {next: "(0.9 + 0.05 * tanh(v)) * x + h(u) * v + d[t-2]", init: 0}}
outputs: {y: x}
mpc:
  horizon: 15
  controls: [u]
  references: {top: {}}
  cost: {stage: "(x - 0.5)**2 + 0.1 * (u - u[t-1])**2", terminal: 5 * (x - 0.5)**2}
  preview: [d]
  bounds: {u: {min: -1, max: 1 + 0.1 * tanh(top), rate: 3 1/s}, x: {max: 0.6}}
""",
    "network_on_windows": """
inputs: {u: {between: hold}, w: {between: hold}, y: {}}
layers: {net: {mlp: {hidden: 5}}, past_u: {fir: {window: 4, init: 0.2}}}
outputs:
  y1:
    expr: "0.8 * y - 0.2 * y[t-2] + 0.3 * net(y, y[t-1], u, u[t-3]) + 0.2 * past_u(w)"
    predicts: "y[t+1]"
  drive: {expr: "u + u[t-1] + u[t-2] + u[t-3] + w + w[t-1]"}
mpc:
  horizon: 10
  controls: [u, w]
  cost: {stage: (y - 0.4)**2 + 0.05 * u**2 + 0.01 * w**2 + 0 * drive, terminal: (y - 0.4)**2}
  bounds:
    u: {min: -1, max: 1}
    w: {min: 0.1, max: 0.1}
    drive: {max: 2}
    y: {max: 0.45, hard: true}
""",
    "blocks_of_a_filter": """
inputs: {u: {between: hold}, y: {}}
layers: {h: {fir: {window: 7, init: 0.15}}}
outputs:
  y1: {expr: "0.7 * y + 0.1 * sin(y[t-1]) + h(u) + 0.1 * y * u[t-2]", predicts: "y[t+1]"}
mpc:
  horizon: 12
  controls: [u]
  references: {top: {preview: true}}
  cost: {stage: (y - 0.5)**2 + 0.02 * u**2, terminal: 3 * (y - 0.5)**2}
  blocks: [1, 1, 4, 6]
  bounds: {u: {min: -1, max: 0.5 + 0.3 * sin(top)}, y1: {max: 0.8}}
""",
    "blocks_and_rates": """
inputs: {u: {between: hold}, w: {between: hold}}
layers: {h: {fir: {window: 5, init: 0.2}}}
states: {x: {next: "0.9 * x + h(u) - 0.1 * x * w", init: 0}}
outputs: {y: x, drive: "u + u[t-1] + u[t-2] + u[t-3] + w"}
mpc:
  horizon: 10
  controls: [w, u]
  cost: "(x - 0.6)**2 + 0.1 * (u - u[t-1])**2 + 0.02 * w**2 + 0 * drive"
  blocks: [2, 3, 5]
  bounds: {u: {min: -1, max: 1, rate: 8}, w: {min: 0.1, max: 0.1}, drive: {max: 1.5}}
""",
    "vectors_and_rates": """
dims: {j: 2}
inputs: {u: {dims: j}, w: {dims: j}}
states: {x: {dims: j, next: "0.9 * x + u[t-2] + 0.1 * w[t-1]", init: 0}}
outputs: {y: x}
mpc:
  horizon: 6
  controls: [u]
  references: {low: {dims: j}}
  cost: sum(x**2) + 0.1 * sum((u - u[t-1])**2)
  bounds: {u: {max: 1, min: low - 1, rate: 4}, x: {max: 3, min: low - 1}}
""",
    "disturbance_decides_slopes": """
inputs: {u: {between: hold}, v: {between: hold}}
layers: {h: {fir: {window: 6, init: 0.1}}}
states: {x: {next: 0.9 * x + sin(v) * h(u), init: 0}}
outputs: {y: x}
mpc:
  horizon: 12
  controls: [u]
  preview: [v]
  cost: {stage: (x - 0.3)**2 + 1e-3 * u**2}
  hessian: gauss_newton
  bounds: {u: {min: -1, max: 1}}
""",
}


def _problem(plant: str, folder: Path, structure: Structure) -> ControlProblem:
    model = load(folder, START + PLANTS[plant])
    control = model.of(ControlProblem)
    assert control is not None
    return replace(control, structure=structure)


def _weights(problem: ControlProblem) -> dict[str, np.ndarray]:
    random = np.random.default_rng(2)
    shapes = {p.name: tuple(axis.size for axis in p.axes) for p in problem.program.parameters}
    return {name: 0.2 * random.normal(size=shape) for name, shape in shapes.items()}


def _library(plant: str, folder: Path, structure: Structure = "condensed") -> ControllerLibrary:
    require_tool("gcc", install="apt install gcc")
    problem = _problem(plant, folder, structure)
    out = folder / structure
    write_controller(problem, _weights(problem), out, prefix="plant", dtype="float64")
    return built_controller(out)


def _given(problem: ControlProblem, random: np.random.Generator) -> dict[str, np.ndarray]:
    fields = input_fields(problem)
    found = {f.identifier: 0.3 * random.normal(size=f.size) for f in fields}
    return found | {"x": 0.3 * random.normal(size=problem.states.size)}


@pytest.mark.parametrize("plant", PLANTS)
def test_plans_are_those_of_the_stages(plant: str, tmp_path: Path) -> None:
    condensed, staged = (_library(plant, tmp_path, s) for s in ("condensed", "staged"))
    problem = _problem(plant, tmp_path, "staged")
    random = np.random.default_rng(5)
    solved = 0
    for _ in range(8):
        given = _given(problem, random)
        own, other = condensed.solve(given), staged.solve(given)
        assert own.status == other.status
        if own.status == 0:
            solved += 1
            # a gradient of 1e-6 over the least curvature, 2e-3
            assert own.control == pytest.approx(other.control, abs=2e-3)
            np.testing.assert_allclose(condensed.plan()[0, :-1], staged.plan()[0, :-1], atol=2e-3)
    assert solved >= 4


@pytest.mark.parametrize(
    ("plant", "dtype"), list(zip(PLANTS, itertools.cycle(DTYPES), strict=False))
)
def test_what_is_called_solved_is_optimal_to_the_interpreter(
    plant: str, dtype: Dtype, tmp_path: Path
) -> None:
    require_tool("gcc", install="apt install gcc")
    problem = _problem(plant, tmp_path, "condensed")
    weights, out = _weights(problem), tmp_path / "c"
    write_controller(problem, weights, out, prefix="plant", dtype=dtype)
    library = built_controller(out)
    assert library.selftest() == 0
    found = compare_controller(problem, weights, out, dtype, "mpc")
    assert found.agrees, found.faults


def test_a_jump_of_what_is_wanted_takes_few_iterations(tmp_path: Path) -> None:
    """A projection finds which limits of controls are active."""
    library = _library("filter_without_states", tmp_path)
    problem = _problem("filter_without_states", tmp_path, "condensed")
    (field,) = input_fields(problem)
    iterations: list[int] = []
    for wanted in (-0.85, 0.85, -2.0, 0.85, -0.3):
        given = {"x": np.zeros(problem.states.size), field.identifier: np.full(field.size, wanted)}
        found = library.solve(given)
        assert found.status == 0
        iterations.append(found.iterations)
    # the barrier alone takes 9 to 16
    assert max(iterations) <= 3, iterations


_BARRIER = {
    "LOWEST_MU": 0.01,
    "HIGHEST_MU": 0.01,
    "KEEP": 0.99,
    "FEWEST": 0.1,
    "NEARLY": 30.0,
    "NEAR_PULL": 0.01,
}


@pytest.mark.parametrize("plant", ["filter_and_rates", "network_on_windows"])
def test_the_first_gain_is_that_of_the_recursion(plant: str, tmp_path: Path) -> None:
    """`feedback` moves the control as a Riccati recursion over all of the memory would."""
    require_tool("gcc", install="apt install gcc")
    laws: list[np.ndarray] = []
    for structure in ("condensed", "staged"):
        problem = _problem(plant, tmp_path, structure)
        out = tmp_path / structure
        write_controller(problem, _weights(problem), out, prefix="plant", dtype="float64")
        source = out / "src" / "plant_mpc.c"
        # the same barrier in both, which the gain hangs on, in the unit of the cost
        scale = trained(problem, _weights(problem)).cost_scale
        text = source.read_text()
        for name, number in _BARRIER.items():
            value = number * scale if name.endswith("_MU") else number
            text, count = re.subn(rf"\b{name} = [^;]*;", f"{name} = {value};", text)
            assert count == 1
        source.write_text(text)
        library = built_controller(out)
        given = _given(problem, np.random.default_rng(1))
        given["x"] = 0.1 * given["x"]
        library.solve(given)
        library.prepare()
        laws.append(library.member("gain")[0])
    own, other = laws
    # both are solved to the tolerance alone, from where the curvature of a network differs
    np.testing.assert_allclose(own, other, rtol=1e-2, atol=1e-3)


OF_ALL_KINDS = (
    *("network_on_windows", "blocks_and_rates", "vectors_and_rates"),
    "disturbance_decides_slopes",
)
"""Together they have what the others have: filters, blocks, rates, both kinds of curvature."""


def test_sources_are_clean_and_touch_nothing_else(tmp_path: Path) -> None:
    require_tool("g++", install="apt install g++")
    strict = ["-Wall", "-Wextra", "-Werror", "-Wdouble-promotion", "-ffp-contract=off"]
    sanitized = ["-O0", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    main = tmp_path / "main.c"
    main.write_text(
        "int plant_mpc_selftest(void);\nint main(void) { return plant_mpc_selftest(); }\n"
    )
    for plant in PLANTS:
        problem = _problem(plant, tmp_path, "condensed")
        out = tmp_path / plant
        write_controller(problem, _weights(problem), out, prefix="plant", dtype="float32")
        sources, include = sorted((out / "src").glob("*.c")), f"-I{out / 'include'}"
        # an optimiser warns of what it finds in either language; sanitizers find more without one
        how = ["-O1", "-c"] if plant in OF_ALL_KINDS else ["-fsyntax-only"]
        compiled = ["g++", "-x", "c++", *strict, *how, include, *sources]
        subprocess.run(compiled, check=True, cwd=out)
        command = ["gcc", "-std=c99", "-pedantic", *strict, *sanitized, include]
        subprocess.run([*command, *sources, main, "-o", out / "run", "-lm"], check=True)
        subprocess.run([out / "run"], check=True)

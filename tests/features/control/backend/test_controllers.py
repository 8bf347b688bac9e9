"""Generated controllers keep their limits, never call solved what is not, and are bits alike."""

import itertools
import re
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from backends.c.host.build import build_library
from msnn.features.control.backend import write_controller
from msnn.features.control.backend.library import ControllerLibrary, multipliers_of, plan_of
from msnn.features.control.backend.structure.rows import rows_of
from msnn.features.control.export.judged_controller import compare_controller
from msnn.features.control.problem.horizon import Given
from msnn.features.control.problem.kkt import Judge
from msnn.features.control.problem.optimal_control import ControlProblem
from msnn.features.control.problem.trained import trained
from msnn.model.load import load_model
from tests.conditions import require_tool
from tests.features.control.backend.built_controller import built_controller
from tests.features.control.backend.strict_builds import build_strictly
from tests.features.control.specs import DELAYED, WINDOW_AND_NO_WEIGHT, load

HERE = Path(__file__).parent
SOLVED, CAPPED, INFEASIBLE, INPUT_NOT_FINITE, NOT_INITIALISED = range(5)
PLANTS = {
    "rates": """
inputs: {u: {between: hold}, d: {between: hold}}
states: {x: {next: 0.9 * x + 0.2 * u + 0.1 * d + 0.05 * sin(x), init: 0}}
outputs: {y: x}
mpc:
  horizon: 12
  controls: [u]
  cost: {stage: "(x - r)**2 + 0.1 * (u - u[t-1])**2", terminal: 5 * (x - r)**2}
  references: {r: {preview: true}, top: {}}
  preview: [d]
  bounds: {u: {min: -1, max: 1 + 0.1 * tanh(top), rate: 3 1/s}, y: {max: 0.5}}
""",
    "equal_bounds_and_one_sample": """
inputs: {u: {between: hold}, v: {between: hold}}
states:
  x: {next: 0.9 * x + 0.2 * u + 0.1 * w, init: 0, range: [-1, 1]}
  w: {next: 0.95 * w + 0.3 * v - 0.1 * x, init: 0, range: [-1, 1]}
outputs: {y: x, power: u * v + x}
mpc:
  horizon: 1
  controls: [u, v]
  cost: {stage: x**2 + w**2 + 0.1 * u**2 + v**2, terminal: x**2 + w**2}
  bounds:
    u: {min: -1, max: 1}
    v: {min: 0.2, max: 0.2}
    w: {max: 0.9, hard: true}
    power: {max: 0.5}
""",
    "window_and_no_weight": WINDOW_AND_NO_WEIGHT,
    "blocks": """
inputs: {u: {between: hold}, v: {between: hold}}
states:
  x: {next: 0.9 * x + 0.3 * u + 0.1 * sin(w), init: 0}
  w: {next: 0.95 * w + 0.3 * v - 0.1 * x * u, init: 0}
outputs: {y: x, drive: u + 0.5 * x}
mpc:
  horizon: 9
  controls: [u, v]
  references: {top: {preview: true}}
  cost: {stage: (x - 0.4)**2 + w**2 + 0.1 * u**2 + 0.05 * v**2, terminal: x**2 + 2 * w**2}
  blocks: [1, 2, 2, 4]
  bounds:
    u: {min: -1, max: 1, rate: 12}
    v: {min: -0.5, max: 0.6 + 0.3 * tanh(top)}
    drive: {max: 0.4}
    w: {min: -0.8, hard: true}
  solver: {interior_point: {structure: staged}}
""",
    "unstable": """
inputs: {u: {between: hold}}
states:
  x: {next: x + 0.1 * v, init: 0}
  v: {next: v + 0.4 * sin(x) + 0.2 * u * cos(x), init: 0}
outputs: {y: x}
mpc:
  horizon: 20
  controls: [u]
  cost: {stage: x**2 + 0.1 * v**2 + 0.01 * u**2, terminal: 10 * x**2}
  bounds: {u: {min: -1, max: 1}}
""",
    "steep": """
inputs: {u: {between: hold, range: [0, 10]}}
states: {h: {next: "max(h + 0.1 * u - 0.3 * sqrt(max(h, 0)), 0)", init: 1, range: [0, 12]}}
outputs: {y: h}
mpc:
  horizon: 10
  controls: [u]
  cost: (h - 1)**2 + 1e-3 * u**2
  hessian: gauss_newton
  bounds: {u: {min: 0, max: 10}, h: {max: 6}}
""",
}
HIGHEST = {"rates": 1.1, "steep": 10.0}
LOWEST = {"steep": 0.0}


def _written(plant: str, folder: Path, dtype: str = "float64") -> Path:
    require_tool("gcc", install="apt install gcc")
    spec = folder / "plant.msnn.yaml"
    spec.write_text(f"msnn: 1\nname: plant\nsample_time: 0.1 s\n{PLANTS[plant]}")
    problem = load_model(spec).of(ControlProblem)
    assert problem is not None
    out = folder / "c"
    write_controller(problem, {}, out, prefix="plant", dtype=dtype)  # pyright: ignore[reportArgumentType]
    return out


def _library(plant: str, folder: Path, dtype: str = "float64") -> ControllerLibrary:
    out = _written(plant, folder, dtype)
    return built_controller(out)


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("plant", PLANTS)
def test_what_is_called_solved_is_optimal_to_the_interpreter(
    plant: str, dtype: str, tmp_path: Path
) -> None:
    out = _written(plant, tmp_path, dtype)
    build_library(out, out / "controller.so")
    problem = load_model(tmp_path / "plant.msnn.yaml").of(ControlProblem)
    assert problem is not None
    found = compare_controller(problem, {}, out, dtype, "mpc")  # pyright: ignore[reportArgumentType]
    assert found.agrees, found.faults


@pytest.mark.parametrize(
    ("plant", "dtype"), list(zip(PLANTS, itertools.cycle(("float64", "float32")), strict=False))
)
def test_drawn_numbers_break_nothing(plant: str, dtype: str, tmp_path: Path) -> None:
    out = _written(plant, tmp_path, dtype)
    program = tmp_path / "fuzz"
    tolerance, real = ("1e-6", "double") if dtype == "float64" else ("1.0001e-3f", "float")
    defined = {
        "HEADER": '"plant_mpc.h"',
        "PREFIX": "plant_mpc",
        "SOLVES": "500",
        "OF_TOLERANCE": tolerance,
        "REAL": real,
        "OF_LOWEST": LOWEST.get(plant, -1.0),
        "OF_HIGHEST": HIGHEST.get(plant, 1.0),
    }
    command = ["gcc", "-std=c99", "-O0", "-ffp-contract=off", "-fsanitize=address,undefined"]
    command += ["-fno-sanitize-recover=all", f"-I{out / 'include'}"]
    command += [f"-D{name}={value}" for name, value in defined.items()]
    sources = [*sorted((out / "src").glob("*.c")), HERE / "fuzz.c"]
    subprocess.run([*command, *sources, "-o", program, "-lm"], check=True)
    done = subprocess.run([program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, (done.returncode, done.stderr[-2000:])
    solved, _, _, refused = map(int, done.stdout.split())
    assert solved > 0
    assert refused > 0


def test_compilers_and_levels_give_the_same_bits(tmp_path: Path) -> None:
    out = _written("unstable", tmp_path)
    found = []
    for compiler, level in itertools.product(("gcc", "clang"), ("-O0", "-O2", "-O3", "-Os")):
        require_tool(compiler, install=f"apt install {compiler}")
        path = build_library(out, tmp_path / f"{compiler}{level}.so", [compiler], (level,))
        library = ControllerLibrary.of_folder(out, path)
        x = np.array([3.0, -1.0])
        plans = []
        for _ in range(5):
            decision = library.solve({"x": x})
            plans.append(library.member("z").tobytes())
            x = library.member("z")[1, :2] + [0.1, -0.2]
            assert decision.status == SOLVED
        found.append(plans)
    assert all(plans == found[0] for plans in found)


def test_sources_are_c_plus_plus_without_warnings(tmp_path: Path) -> None:
    for plant in PLANTS:
        folder = tmp_path / plant
        folder.mkdir()
        build_strictly(_written(plant, folder))


def test_nothing_moves_the_control_where_the_state_is_not_a_number(tmp_path: Path) -> None:
    library = _library("unstable", tmp_path)
    before = library.solve({"x": [2.0, 0.0]})
    after = library.solve({"x": [np.nan, 0.0]})
    assert before.status == SOLVED
    assert after.status == INPUT_NOT_FINITE
    assert after.control.tobytes() == before.control.tobytes()
    assert library.solve({"x": [2.0, 0.0]}).status == SOLVED


def test_what_was_applied_beyond_the_limits_is_not_returned(tmp_path: Path) -> None:
    library = _library("unstable", tmp_path)
    for applied, limit in ((-5.0, -1.0), (5.0, 1.0)):
        library.reset([applied])
        found = library.solve({"x": [np.nan, 0.0]})
        assert found.status == INPUT_NOT_FINITE
        assert found.control == limit


def test_golden_solves_have_each_kind_of_end_and_tell_other_bits(tmp_path: Path) -> None:
    out = _written("rates", tmp_path)
    test = (out / "src" / "plant_mpc_selftest.c").read_text(encoding="utf-8")
    rows = re.findall(r"^    \{[01], (\d), (\d+), ", test, re.MULTILINE)
    assert {int(status) for status, _ in rows} == {SOLVED, INFEASIBLE, INPUT_NOT_FINITE}
    for compiler, level in itertools.product(("gcc", "clang"), ("-O0", "-O3")):
        require_tool(compiler, install=f"apt install {compiler}")
        path = build_library(out, tmp_path / f"{compiler}{level}.so", [compiler], (level,))
        assert ControllerLibrary.of_folder(out, path).selftest() == 0
    source = out / "src" / "plant_mpc.c"
    text = source.read_text(encoding="utf-8")
    changed = re.sub(r"(const double KEEP = )0.99;", r"\1 0.985;", text)
    assert changed != text
    source.write_text(changed, encoding="utf-8")
    path = build_library(out, tmp_path / "other.so")
    assert ControllerLibrary.of_folder(out, path).selftest() == 16


def test_a_struct_that_nobody_began_is_refused(tmp_path: Path) -> None:
    library = _library("unstable", tmp_path)
    library._state[:] = 0  # pyright: ignore[reportPrivateUsage]
    assert library.solve({"x": [2.0, 0.0]}).status == NOT_INITIALISED


def test_the_header_says_which_spec_it_belongs_to(tmp_path: Path) -> None:
    model = load(tmp_path, DELAYED)
    control = model.of(ControlProblem)
    assert control is not None
    assert model.program.spec_hash == control.program.spec_hash != ""


def test_feedback_of_the_predicted_state_is_the_planned_control(tmp_path: Path) -> None:
    library = _library("unstable", tmp_path)
    library.solve({"x": [0.5, 0.0]})
    plan = library.member("z")
    library.prepare()
    decision = library.feedback({"x": plan[1, :2]})
    assert decision.control == pytest.approx(plan[1, 2:], abs=1e-3)


def test_feedback_follows_the_measured_state(tmp_path: Path) -> None:
    """To first order it decides what a solve decides."""
    library = _library("unstable", tmp_path)
    library.solve({"x": [0.05, 0.0]})
    x = library.member("z")[1, :2] + [1e-3, -2e-3]
    library.prepare()
    fast = library.feedback({"x": x}).control
    library.init()
    assert fast == pytest.approx(library.solve({"x": x}).control, abs=5e-3)


def test_hard_limits_that_cannot_hold_are_infeasible(tmp_path: Path) -> None:
    library = _library("equal_bounds_and_one_sample", tmp_path)
    assert library.solve({"x": [-1.0, 1.0]}).status == INFEASIBLE
    assert library.solve({"x": [0.1, 0.1]}).status == SOLVED


def test_a_hard_limit_is_not_exceeded_by_what_pays(tmp_path: Path) -> None:
    """A limit that is kept to the tolerance, with a steep cost behind it, saves more than that."""
    text = """
msnn: 1
name: plant
sample_time: 1 s
inputs: {u: {between: hold}}
states:
  x: {next: 0.9 * x - 0.206 * w + 0.299 * u, init: 0}
  w: {next: -0.384 * x + 1.43 * w + 0.98 * u + 0.2 * w**2, init: 0}
outputs: {y: 1 * x}
mpc:
  horizon: 2
  controls: [u]
  cost:
    stage: 73.2 * ((x + 1.6957)**2 + w**2) + 20.77 * u**2
    terminal: 49.7 * (x + 1.6957)**2
  bounds: {u: {min: -9.6, max: 10.4}, x: {max: -0.5, hard: true}}
"""
    problem = load(tmp_path, text).of(ControlProblem)
    assert problem is not None
    problem = trained(problem, {})
    out = tmp_path / "c"
    write_controller(problem, {}, out, prefix="plant", dtype="float64")
    library = built_controller(out)
    state = np.array([0.11222874877812497, 0.02267833726484067])
    assert library.solve({"x": state}).status == SOLVED
    plan = plan_of(problem, library)
    multipliers = multipliers_of(problem, rows_of(problem), library)
    found = Judge(problem).residuals(Given(state, {}, {}), plan, multipliers)
    assert found.largest <= 2 * problem.tolerance


def test_a_capped_plan_that_breaks_a_hard_limit_is_infeasible(tmp_path: Path) -> None:
    require_tool("gcc", install="apt install gcc")
    problem = load(tmp_path, DELAYED).of(ControlProblem)
    assert problem is not None
    problem = replace(problem, structure="staged")  # which runs out of iterations here
    out = tmp_path / "c"
    write_controller(
        problem, {"a": np.array(0.9), "b": np.array(0.5)}, out, prefix="plant", dtype="float64"
    )
    library = built_controller(out)
    state = [0.82260818, -1.59768709, 2.74264536, 2.02007337, -1.06477104, 0.07456302]
    found = library.solve({"x": state, "d": 0.0, "r": 1.0})
    assert found.iterations == problem.iterations
    assert found.status == INFEASIBLE


def test_a_plan_is_found_again_after_a_failure(tmp_path: Path) -> None:
    library = _library("unstable", tmp_path)
    library.solve({"x": [1e30, 1e30]})
    assert library.solve({"x": [0.5, 0.0]}).status == SOLVED

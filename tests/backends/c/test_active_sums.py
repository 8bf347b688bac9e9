"""Only active fuzzy sets are evaluated, with the bits of the sum over all of them."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from backends.c import COptions
from backends.c_lowering.fuzzy_sets import even_points, find_active_sums
from compiler.interpreter.interpreter import Interpreter, physical_weights
from compiler.ir.program import Program
from compiler.passes.analyses.compact_sets import active_sums, compact_sets, supports
from compiler.passes.settle_zeros import settle_zeros
from compiler.passes.to_step_form import to_step_form
from msnn.model.load import load_model
from tests.backends.c.c_programs import assert_same_bits, built
from tests.language.compiled import compiled

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"

HEAD = """
inputs:
  x: {unit: 1, on_invalid: trust}
  y: {unit: 1, on_invalid: trust}
  z: {unit: 1, on_invalid: trust}
dims: {row: 4, column: 5, joint: [a, b]}
"""

SPECS = {
    "even": """
layers:
  phi: {fuzzify: {centers: {linspace: [-3, 3, 7]}}}
  cell: {local_model: {by: phi(x), cell: {linear: {bias: false}}}}
outputs: {out: cell(z)}
""",
    "tenths": """
layers:
  phi: {fuzzify: {centers: "linspace(-0.7, 2.1, 29)"}}
  cell: {local_model: {by: phi(x), cell: {linear: {bias: true}}}}
outputs: {out: cell(z)}
""",
    "uneven": """
layers:
  phi: {fuzzify: {centers: [-2, -1.5, 0.1, 0.2, 3, 4.75]}}
  cell: {local_model: {by: phi(x), cell: {linear: {out: joint}}}}
outputs: {out: "sum(cell(z))"}
""",
    "two": """
layers:
  phi: {fuzzify: {centers: [-0.3, 0.7]}}
  cell: {local_model: {by: phi(x), cell: {fir: {window: 6}}}}
outputs: {out: cell(z)}
""",
    "rectangular": """
layers:
  phi: {fuzzify: {centers: [-2, -1, 0.3, 2], membership: rectangular}}
  cell: {local_model: {by: phi(x), cell: {linear: {}}}}
outputs: {out: cell(z)}
""",
    "learned": """
layers:
  phi: {fuzzify: {centers: [-2, -1, 0.25, 2, 2.5], learn: true}}
  cell: {local_model: {by: phi(x), cell: {linear: {}}}}
outputs: {out: cell(z)}
""",
    "grid": """
layers:
  phi: {fuzzify: {centers: [-2, -1, 0.5, 2], dim: row}}
  psi: {fuzzify: {centers: {linspace: [-1, 1, 5]}, dim: column}}
  grid: {fuzzify: {over: [phi, psi], combine: product}}
  cell: {local_model: {by: "grid(x, y)", cell: {linear: {}}}}
  other: {local_model: {by: "grid(x, y)", cell: {linear: {bias: false}}}}
outputs: {out: cell(z) + other(x)}
""",
    "one of two": """
layers:
  phi: {fuzzify: {centers: [-2, -1, 0.5, 2], dim: row}}
  psi: {fuzzify: {centers: {linspace: [-1, 1, 5]}, dim: column}}
  grid: {fuzzify: {over: [phi, psi], combine: product}}
outputs: {out: "sum(grid(x, y), over=row)"}
""",
    "two by two": """
layers:
  phi: {fuzzify: {centers: [-2, -1, 0.5, 2], dim: row}}
  psi: {fuzzify: {centers: {linspace: [-1, 1, 5]}, dim: column, membership: rectangular}}
  cell: {local_model: {by: [phi(x), psi(y)], cell: {linear: {}}}}
outputs: {out: cell(z)}
""",
    "table": """
layers:
  map: {interpolation: {x: [0, 1, 3], x2: [-1, 0, 1], y: [[0, -1, 2], [3, -4, 5], [-6, 7, 8]]}}
outputs: {out: "map(x, y)"}
""",
}
POINTS = np.array(
    [-3, -2, -1.5, -1, -0.7, -0.5, -0.3, 0, 0.1, 0.2, 0.3, 0.5, 0.7, 1, 2, 2.1, 2.5, 3, 4.75]
)


def _program(name: str) -> Program:
    return replace(to_step_form(compiled(HEAD + SPECS[name])), losses=())


def _inputs() -> dict[str, np.ndarray]:
    """Values on all points, next to them, between and beyond; the factor is often 0."""
    random = np.random.default_rng(1)
    near = np.float32(POINTS)
    x = np.concatenate(
        [
            near,
            np.nextafter(near, np.float32(9)),
            np.nextafter(near, np.float32(-9)),
            random.uniform(-4, 5, 200),
            [0.0, -0.0, 1e-40, -1e-40, 1e30, -1e30, math.nan, math.inf, -math.inf],
        ]
    ).astype(np.float32)
    zeros = np.where(random.uniform(size=x.size) < 0.5, 1.0, 0.0)
    signs = np.where(random.uniform(size=x.size) < 0.5, -1.0, 1.0)
    z = (random.uniform(-2, 2, x.size) * zeros * signs).astype(np.float32)
    return {"x": x, "y": random.permutation(x[:-3]).take(range(x.size), mode="wrap"), "z": z}


@pytest.mark.parametrize("constant_time", [False, True])
@pytest.mark.parametrize("name", SPECS)
def test_bits_are_those_of_all_sets(name: str, constant_time: bool, tmp_path: Path) -> None:
    program = settle_zeros(_program(name))
    assert find_active_sums(program.step, [out.node for out in program.outputs]).sums
    inputs = {s.name: _inputs()[s.name] for s in program.signals}
    steps = len(inputs["x"])
    options = COptions(constant_time=constant_time)
    step = built(program, tmp_path, options, flags=("-O2", "-fsanitize=undefined"))
    step.reset({p: np.zeros(5, np.float32) for p in ("z",) if program.states})
    found, _ = step.run(inputs, steps)
    states = {s.name: np.zeros((1, *(a.size for a in s.axes)), np.float32) for s in program.states}
    judge = Interpreter(program, physical_weights(program, {}), np.float32)
    expected = np.empty_like(found["out"])
    for k in range(steps):
        log = {signal: values[k : k + 1] for signal, values in inputs.items()}
        result = judge.step(log, 0, states)
        expected[k], states = result.outputs["out"][0], result.next_states
    assert_same_bits(found, {"out": expected})


def test_only_the_sign_of_zero_changes() -> None:
    program = _program("even")
    settled = settle_zeros(program)
    assert settled != program
    assert settle_zeros(settled) == settled
    log = {"x": np.array([0.25]), "z": np.array([0.0])}
    weights = {"cell.weight": -np.ones((7, 1))}
    before, after = (
        Interpreter(p, weights).step(log, 0, {}).outputs["out"][0] for p in (program, settled)
    )
    assert before == after == 0.0
    assert (np.signbit(before), np.signbit(after)) == (True, False)


def test_sets_that_are_shown_are_computed_whole() -> None:
    spec = HEAD + SPECS["even"].replace("{out: cell(z)}", "{out: cell(z), degrees: phi(x)}")
    program = settle_zeros(to_step_form(compiled(spec)))
    assert not find_active_sums(program.step, [out.node for out in program.outputs]).sums


def test_wide_sets_have_no_support() -> None:
    spec = HEAD + SPECS["even"].replace("7]}}}", "7]}, membership: gaussian}}")
    program = to_step_form(compiled(spec))
    assert not active_sums(program.step, supports(program.step, compact_sets(program.step)))


@pytest.mark.parametrize("count", [3, 7, 10, 29, 100, 1001])
def test_even_points_are_found_by_one_product(count: int) -> None:
    points = np.linspace(-0.7, 2.1, count)
    found = even_points(points.tolist(), "float32")
    assert found is not None
    rounded = points.astype(np.float32)
    x = np.concatenate([rounded[:-1], np.nextafter(rounded[1:], np.float32(-9))])
    place = ((x - np.float32(found.origin)) * np.float32(found.factor)).astype(np.uint32)
    place -= x < rounded[place]
    assert np.array_equal(place, np.searchsorted(rounded, x, side="right") - 1)


def test_uneven_points_are_searched() -> None:
    assert even_points([0.0, 1.0, 3.0], "float32") is None


@pytest.mark.parametrize(
    ("spec", "sets"),
    [
        ("gallery/battery.msnn.yaml", 1),
        ("gallery/engine_map.msnn.yaml", 2),
        ("gallery/lane_keeper.msnn.yaml", 2),
        ("gallery/reference.msnn.yaml", 1),
        ("gallery/arm_friction.msnn.yaml", 0),  # gaussian sets are nowhere 0
        ("vehicle_steering/vehicle.msnn.yaml", 2),
    ],
)
def test_compact_sets_of_the_examples_are_found_after_all_passes(spec: str, sets: int) -> None:
    """A pass that rewrites a formula of `fuzzy_sets` would hide them from `compact_sets`."""
    program = to_step_form(load_model(EXAMPLES / spec).program)
    assert len(compact_sets(program.step)) == sets

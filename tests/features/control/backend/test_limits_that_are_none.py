"""Limits that are NaN or contradict each other at t: told by the status, and what is returned is
a number inside all limits that are numbers."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
import pytest

from backends.c.host.build import build_library
from backends.c_language.literals import Dtype
from msnn.features.control.backend import write_controller
from msnn.features.control.backend.library import ControllerLibrary, Decision
from msnn.features.control.problem.optimal_control import ControlProblem, Structure
from tests.conditions import require_tool
from tests.features.control.specs import load

SOLVED, CAPPED, INFEASIBLE, INPUT_NOT_FINITE, NOT_INITIALISED = range(5)
TEXT = """
msnn: 1
name: plant
sample_time: 0.1 s
inputs: {u: {between: hold}, v: {between: hold}}
states:
  x: {next: 1.05 * x + 0.1 * sin(x) + 0.2 * u, init: 0}
  w: {next: 0.9 * w + 0.3 * v, init: 0}
outputs: {y: x}
mpc:
  horizon: 6
  controls: [u, v]
  references:
    {top: {preview: true}, low: {}, high: {preview: true}, open: {}, soft: {preview: true},
     wide: {}, q: {}}
  cost: {stage: (x - 1)**2 + sqrt(q) * w**2 + 0.05 * u**2 + v**2, terminal: 3 * (x - 1)**2}
  bounds:
    u: {max: sqrt(top)RATE}
    v: {min: low / open, max: high}
    x: {max: soft / wide}
"""
KNOWN = {"top": 4.0, "low": -1.0, "high": 2.0, "open": 1.0, "soft": 9.0, "wide": 1.0, "q": 1.0}
PREVIEWED, STAGES = ("top", "high", "soft"), 7


@dataclass(frozen=True)
class Built:
    """A controller, and where it finds its state."""

    library: ControllerLibrary
    names: tuple[str, ...]

    def state(self, x: float, **others: float) -> np.ndarray:
        known = {"x": x, "w": 0.5, **others}
        return np.array([known.get(name, 0.0) for name in self.names])

    def values(self, x: float, known: dict[str, object], **state: float) -> dict[str, np.ndarray]:
        all_known = KNOWN | known
        held = {
            name: np.broadcast_to(np.asarray(value), STAGES if name in PREVIEWED else 1)
            for name, value in all_known.items()
        }
        return {"x": self.state(x, **state), **held}

    def solve(self, x: float, known: dict[str, object], **state: float) -> Decision:
        return self.library.solve(self.values(x, known, **state))

    def feedback(self, x: float, known: dict[str, object]) -> Decision:
        return self.library.feedback(self.values(x, known))


PARTS: dict[str, tuple[str, str]] = {
    "plain": ("", ""),
    "blocks_and_rates": ("  blocks: [2, 4]\n", ", rate: 30"),
}
KINDS = list(itertools.product(("staged", "condensed"), ("float64", "float32"), PARTS))


def _at(stage: int, value: float, otherwise: float) -> np.ndarray:
    values = np.full(STAGES, otherwise)
    values[stage] = value
    return values


@pytest.fixture(scope="module", params=KINDS, ids="-".join)
def built(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Built:
    require_tool("gcc", install="apt install gcc")
    structure: Structure
    dtype: Dtype
    structure, dtype, part = request.param
    folder = tmp_path_factory.mktemp("plant")
    blocks, rate = PARTS[part]
    problem = load(folder, TEXT.replace("RATE", rate) + blocks).of(ControlProblem)
    assert problem is not None
    names = tuple(m.name for m in problem.states.members for _ in range(m.size))
    problem = replace(problem, structure=structure)
    write_controller(problem, {}, folder / "c", prefix="plant", dtype=dtype)
    library = build_library(folder / "c", folder / "c" / "controller.so", flags=("-O0",))
    return Built(ControllerLibrary.of_folder(folder / "c", library), names)


NAN_LIMITS: dict[str, dict[str, object]] = {
    "one-sided": {"top": -1.0},
    "of a sample to come": {"top": _at(3, -1.0, 4.0)},
    "of two": {"low": 0.0, "open": 0.0},
    "soft": {"soft": 0.0, "wide": 0.0},
    "soft, of a sample to come": {"soft": _at(6, 0.0, 9.0), "wide": 0.0},
}
NONE_CAN_MEET: dict[str, dict[str, object]] = {
    "above all": {"open": 0.0, "low": 1.0},
    "crossed": {"low": 3.0},
    "soft, below all": {"soft": -9.0, "wide": 0.0},
}


@pytest.mark.parametrize("known", NAN_LIMITS.values(), ids=NAN_LIMITS.keys())
@pytest.mark.parametrize("is_warm", [False, True], ids=["cold", "warm"])
def test_a_limit_that_is_nan(built: Built, known: dict[str, object], is_warm: bool) -> None:
    built.library.init()
    before = built.solve(0.5, {}).control if is_warm else np.zeros(2)
    found = built.solve(0.5, known)
    assert found.status == INPUT_NOT_FINITE
    assert np.array_equal(found.control, before)
    assert built.solve(0.5, {}).status == SOLVED
    built.library.prepare()
    assert built.feedback(0.6, known).status == INPUT_NOT_FINITE
    assert built.solve(0.5, {}).status == SOLVED


@pytest.mark.parametrize("known", NONE_CAN_MEET.values(), ids=NONE_CAN_MEET.keys())
@pytest.mark.parametrize("is_warm", [False, True], ids=["cold", "warm"])
def test_limits_that_no_number_meets(built: Built, known: dict[str, object], is_warm: bool) -> None:
    built.library.init()
    before = built.solve(0.5, {}).control if is_warm else np.zeros(2)
    found = built.solve(0.5, known)
    assert found.status == INFEASIBLE
    assert found.control[0] == before[0]
    # of two that contradict each other the upper one is kept
    assert found.control[1] == (2 if "low" in known and known["low"] == 3.0 else before[1])
    assert built.solve(0.5, {}).status == SOLVED
    built.library.prepare()
    found = built.feedback(0.6, known)
    assert found.status == INFEASIBLE
    assert np.all(np.isfinite(found.control))
    assert found.control[1] <= 2
    assert built.solve(0.5, {}).status == SOLVED


def test_infinite_limits_are_none_on_their_own_side(built: Built) -> None:
    built.library.init()
    free = built.solve(0.5, {"open": 0.0, "wide": 0.0})
    assert free.status == SOLVED
    built.library.init()
    # of limits that are nowhere near: the barrier leaves some room to them
    far = built.solve(0.5, {"low": -30.0, "soft": 30.0})
    assert far.status == SOLVED
    assert free.control == pytest.approx(far.control, abs=1e-2)


REFUSED: dict[str, tuple[dict[str, object], dict[str, float]]] = {
    "measured": ({}, {"x": np.nan}),
    "reference": ({"q": np.nan}, {}),
    "reference of another limit": ({"low": np.nan}, {}),
}


@pytest.mark.parametrize(("bad", "state"), REFUSED.values(), ids=REFUSED.keys())
@pytest.mark.parametrize("call", ["solve", "feedback"])
def test_what_is_refused_keeps_the_limits_of_now(
    built: Built, bad: dict[str, object], state: dict[str, float], call: str
) -> None:
    """Also limits that have moved since the last control was applied."""
    built.library.init()
    before = built.solve(-3.0, {}).control
    assert before[0] > 1
    x = state.get("x", -3.0)
    found = getattr(built, call)(x, {"top": 0.25} | bad)
    assert found.status == INPUT_NOT_FINITE
    assert found.control.tolist() == [0.5, before[1]]
    built.library.init()
    found = getattr(built, call)(x, {"low": 0.25, "top": 0.25} | bad)
    assert found.control.tolist() == [0.0, 0.0 if "low" in bad else 0.25]


def test_feedback_keeps_the_limits_of_now(built: Built) -> None:
    built.library.init()
    for _ in range(3):
        assert built.solve(-3.0, {}).control[0] > 1
    built.library.prepare()
    found = built.feedback(-3.0, {"top": 0.25})
    assert found.status == CAPPED
    assert found.control[0] <= 0.5
    # a step that was begun within other limits is no plan of these
    found = built.solve(-3.0, {"top": 0.25})
    assert found.status == SOLVED
    assert found.control[0] == pytest.approx(0.5, abs=1e-3)


def test_feedback_leaves_limits_to_come_that_contradict_each_other_to_a_solve(built: Built) -> None:
    built.library.init()
    assert built.solve(0.5, {}).status == SOLVED
    crossed: dict[str, object] = {"high": _at(3, -5.0, 2.0)}
    # those of its own sample are well
    assert built.feedback(0.5, crossed).status == CAPPED
    built.library.prepare()
    assert built.feedback(0.5, crossed).status == INFEASIBLE
    assert built.solve(0.5, {}).status == SOLVED


def test_a_weight_that_is_nan_is_never_solved(built: Built) -> None:
    for is_warm in (False, True):
        built.library.init()
        before = built.solve(0.5, {}).control if is_warm else np.zeros(2)
        found = built.solve(0.5, {"q": -1.0})
        assert found.status == INFEASIBLE
        assert np.array_equal(found.control, before)
        assert built.solve(0.5, {}).status == SOLVED


def test_a_struct_that_nobody_began_keeps_the_limits_of_now(built: Built) -> None:
    built.library.member("z")  # the struct is there; its bytes are those of nobody
    state = built.library._state.view(np.uint8)  # pyright: ignore[reportPrivateUsage]
    state[:] = 0xA5
    found = built.solve(0.5, {"low": 0.25})
    assert found.status == NOT_INITIALISED
    assert found.control.tolist() == [0.0, 0.25]
    state[:] = 0xA5
    assert built.solve(np.nan, {"top": -1.0}).control.tolist() == [0.0, 0.0]

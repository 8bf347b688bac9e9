"""The interpreter against rollouts written by hand, number by number, without a tolerance (R4)."""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from compiler.interpreter.interpreter import Interpreter, physical_weights
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Graph, Output, Parameter, Program, Role, Signal
from compiler.ir.types import Axis, Type
from compiler.passes.close_loop import close_loop
from tests.programs import SAMPLES, Log

Weights = dict[str, NDArray[np.float64]]
Reference = Callable[[Log, int, int, Weights], dict[str, list[object]]]


def _dot(left: NDArray[np.float64], right: NDArray[np.float64]) -> float:
    """The oldest product first, then one after the other."""
    total = left[0] * right[0]
    for a, b in zip(left[1:], right[1:], strict=True):
        total = total + a * b
    return total


def _fir(log: Log, t0: int, steps: int, w: Weights) -> dict[str, list[object]]:
    x = list(log["x"][t0 - 4 : t0 + 1])
    outputs: list[object] = []
    for t in range(t0, t0 + steps):
        force = log["F"][t]
        x.append(_dot(w["h.weight"], np.array(x[-5:])) + w["g.weight"][0] * force)
        outputs.append(x[-1])
    return {"x_next": outputs}


def _spring_damper(log: Log, t0: int, steps: int, w: Weights) -> dict[str, list[object]]:
    state = np.array([log["x.meas"][t0], w["v_start"]])
    position: list[object] = []
    for t in range(t0, t0 + steps):

        def slope(s: NDArray[np.float64], force: float = log["F"][t]) -> NDArray[np.float64]:
            resisting = w["damping"] * s[1] + w["stiffness"] * s[0]
            return np.array([s[1], (force - resisting) / w["mass"]])

        position.append(state[0])
        k1 = slope(state)
        k2 = slope(state + 0.025 * k1)
        k3 = slope(state + 0.025 * k2)
        k4 = slope(state + 0.05 * k3)
        state = state + (0.05 / 6) * (k1 + 2.0 * (k2 + k3) + k4)
    return {"position": position}


def _fuzzy(log: Log, t0: int, steps: int, w: Weights) -> dict[str, list[object]]:
    v = list(log["v"][t0 - 2 : t0 + 1])
    shown: list[object] = []
    for t in range(t0, t0 + steps):
        terms: list[float] = []
        for cell, center in enumerate((-1.0, 0.0, 1.0)):
            degree = max(1.0 - abs(v[-1] - center), 0.0)
            pushed = w["model.gain"][cell] * log["u"][t - 1]
            terms.append(degree * (_dot(w["model.weight"][cell], np.array(v[-3:])) + pushed))
        v.append(np.tanh(terms[0] + terms[1] + terms[2]))
        shown.append(min(max(v[-1], -0.9), 0.9))
    return {"v_next": list(v[3:]), "v_shown": shown}


def _arm(log: Log, t0: int, steps: int, w: Weights) -> dict[str, list[object]]:
    q = list(log["q"][t0 - 3 : t0 + 1])
    shown: list[object] = []
    for t in range(t0, t0 + steps):
        following = np.empty(3)
        for j in range(3):
            own = _dot(w["own.weight"][j], np.array([row[j] for row in q[-4:]]))
            coupled = _dot(w["coupling"][j], log["tau"][t])
            waves = np.sin(np.array([1.0, 2.0]) * q[-1][j])
            following[j] = own + coupled + _dot(waves, w["shape"][:, j])
        q.append(following)
        mirrored = np.array([-following[1], -following[2], following[0]])
        shown.append(
            np.array([m if abs(f) > 0.5 else f for m, f in zip(mirrored, following, strict=True)])
        )
    return {"q_next": list(q[4:]), "q_shown": shown}


def _driver(log: Log, t0: int, steps: int, w: Weights) -> dict[str, list[object]]:
    u = list(log["u"][t0 - 3 : t0])
    errors: list[object] = []
    for t in range(t0, t0 + steps):
        look = _dot(w["look.weight"], log["road"][t - 1 : t + 4])
        u.append(look + _dot(w["habit.weight"], np.array(u[-3:])))
        errors.append(_dot(w["turn.weight"], np.array(u[-3:])) + u[-1] - log["road"][t])
    return {"command": list(u[3:]), "error": errors}


def _sensor(log: Log, t0: int, steps: int, w: Weights) -> dict[str, list[object]]:
    level = log["sensor"][t0 - 2]
    levels: list[object] = []
    for t in range(t0, t0 + steps):
        levels.append(level)
        mean = _dot(np.array([0.25, 0.25, 0.5]), log["sensor"][t - 4 : t - 1])
        pumped = 0.02 * np.exp(-log["pump"][t - 1])
        level = level + w["rate"] * (mean - level) + pumped
    return {"level_now": levels}


REFERENCES: dict[str, Reference] = {
    "fir_closed_loop": _fir,
    "spring_damper_rk4": _spring_damper,
    "fuzzy_local_models": _fuzzy,
    "joint_arm": _arm,
    "preview_driver": _driver,
    "late_sensor": _sensor,
}


def test_every_sample_has_a_reference() -> None:
    assert REFERENCES.keys() == SAMPLES.keys()


@pytest.mark.parametrize("name", SAMPLES)
def test_rollout_is_the_hand_written_one(name: str) -> None:
    sample = SAMPLES[name]()
    program = close_loop(sample.program, sample.closed)
    log, starts, steps = sample.log(120, 5), [4, 17, 60], 50
    rollout = Interpreter(program).rollout(log, starts, steps)
    weights = physical_weights(program, {})
    for member, t0 in enumerate(starts):
        for output, expected in REFERENCES[name](log, t0, steps, weights).items():
            assert np.array_equal(rollout.outputs[output][member], np.array(expected)), output


@pytest.mark.parametrize("name", SAMPLES)
def test_each_member_of_a_batch_runs_as_if_it_were_alone(name: str) -> None:
    sample = SAMPLES[name]()
    interpreter, log = Interpreter(sample.program), sample.log(60, 1)
    together = interpreter.rollout(log, np.array([5, 9, 30]), 20)
    for member, t0 in enumerate((5, 9, 30)):
        alone = interpreter.rollout(log, t0, 20)
        for output, values in alone.outputs.items():
            assert np.array_equal(values[0], together.outputs[output][member])


@pytest.mark.parametrize("name", SAMPLES)
def test_float32_values_are_float32_all_the_way(name: str) -> None:
    sample = SAMPLES[name]()
    interpreter, log = Interpreter(sample.program, dtype=np.float32), sample.log(40, 1)
    values = interpreter.step(log, [5, 6], interpreter.start(log, [5, 6]))
    for index, value in enumerate(values.nodes):
        assert value is None or value.dtype in (np.float32, np.bool_), index
    rollout = Interpreter(sample.program).rollout(log, [5, 6], 20)
    short = interpreter.rollout(log, [5, 6], 20)
    for output, expected in rollout.outputs.items():
        # 20 steps of a handful of roundings at 6e-8 each, of values near 1
        assert np.allclose(short.outputs[output], expected, rtol=0, atol=2e-5)


def test_sums_start_with_element_0_and_go_on_one_by_one() -> None:
    count = 200
    axis = Axis("k", count)
    random = np.random.default_rng(2)
    log = {name: random.normal(size=(3, count)).astype(np.float32) for name in ("a", "b")}
    b = GraphBuilder()
    left, right = (b.signal(name, 0, 0, Type((axis,))) for name in ("a", "b"))
    total, product = b.sum(left, "k"), b.contract(left, right)
    signals = tuple(Signal(name, Role.INPUT, (axis,)) for name in ("a", "b"))
    outputs = (Output("total", total), Output("product", product))
    program = Program("sums", None, signals, (), (), b.graph(), Graph(), outputs)
    found = Interpreter(program, dtype=np.float32).step(log, [0, 1, 2], {}).outputs
    for member in range(3):
        a, b_row = log["a"][member], log["b"][member]
        total32, product32 = a[0], a[0] * b_row[0]
        for i in range(1, count):
            total32 = total32 + a[i]
            product32 = product32 + a[i] * b_row[i]
        assert found["total"][member] == total32
        assert found["product"][member] == product32
    assert not np.array_equal(found["total"], log["a"].sum(axis=1)), "the order makes no difference"


def test_sum_of_one_element_keeps_a_negative_zero() -> None:
    b = GraphBuilder()
    axis = Axis("k", 1)
    total = b.sum(b.signal("a", 0, 0, Type((axis,))), "k")
    signals = (Signal("a", Role.INPUT, (axis,)),)
    program = Program("zero", None, signals, (), (), b.graph(), Graph(), (Output("y", total),))
    value = Interpreter(program).step({"a": np.array([[-0.0]])}, 0, {}).outputs["y"]
    assert np.signbit(value[0])


def test_minimum_and_maximum_take_the_first_of_a_tie_and_any_nan() -> None:
    b = GraphBuilder()
    left, right = b.signal("a", 0, 0, Type()), b.signal("b", 0, 0, Type())
    outputs = (
        Output("low", b.minimum(left, right)),
        Output("high", b.maximum(left, right)),
    )
    signals = (Signal("a", Role.INPUT), Signal("b", Role.INPUT))
    program = Program("ties", None, signals, (), (), b.graph(), Graph(), outputs)
    nan = float("nan")
    log = {"a": np.array([0.0, -0.0, nan, 1.0, 1.0]), "b": np.array([-0.0, 0.0, 1.0, nan, 2.0])}
    found = Interpreter(program).step(log, np.arange(5), {}).outputs
    for value in found.values():
        assert list(np.signbit(value[:2])) == [False, True]
        assert np.isnan(value[2:4]).all()
    assert (found["low"][4], found["high"][4]) == (1.0, 2.0)


def test_rows_outside_the_log_are_refused() -> None:
    sample = SAMPLES["fir_closed_loop"]()
    interpreter, log = Interpreter(sample.program), sample.log(10, 0)
    with pytest.raises(IndexError, match="`x` has rows 0 … 9 in the log"):
        interpreter.step(log, [3, 5], {})
    with pytest.raises(IndexError, match=r"reads -?\d+ … 10"):
        interpreter.step(log, 9, {})
    assert interpreter.step(log, 9, {}, losses=False).losses == {}


def test_losses_come_with_their_targets_from_the_log() -> None:
    sample = SAMPLES["fir_closed_loop"]()
    log = sample.log(30, 0)
    values = Interpreter(close_loop(sample.program, ["x"])).step(
        log, [7, 8], {"x.tape": np.zeros((2, 5))}
    )
    prediction, target = values.losses["x_next"]
    assert np.array_equal(prediction, values.outputs["x_next"])
    assert target is not None
    assert np.array_equal(target, log["x"][[8, 9]])


def test_weights_replace_initial_values_and_must_fit() -> None:
    sample = SAMPLES["fir_closed_loop"]()
    log = sample.log(30, 0)
    weights = {"h.weight": np.zeros(5), "g.weight": np.array([2.0]), "else": np.zeros(3)}
    found = Interpreter(sample.program, weights).step(log, 9, {}).outputs["x_next"]
    assert found[0] == 2.0 * log["F"][9]
    with pytest.raises(ValueError, match=r"`h.weight` have shape \(4,\), not \(5,\)"):
        Interpreter(sample.program, {"h.weight": np.zeros(4)})
    with pytest.raises(ValueError, match="float32 or float64, not int64"):
        Interpreter(sample.program, dtype=np.int64)


def test_floating_errors_are_silent() -> None:
    b = GraphBuilder()
    zero = b.constant(0.0)
    outputs = (
        Output("nan", b.divide(zero, zero)),
        Output("infinite", b.divide(b.constant(1.0), b.signal("a", 0, 0, Type()))),
        Output("root", b.apply("sqrt", b.parameter("p", Type()))),
    )
    program = Program(
        "silent",
        None,
        (Signal("a", Role.INPUT),),
        (Parameter("p", initial=(-1.0,)),),
        (),
        b.graph(),
        Graph(),
        outputs,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = Interpreter(program).step({"a": np.zeros(1)}, 0, {}).outputs
    assert np.isnan(found["nan"][0])
    assert np.isnan(found["root"][0])
    assert found["infinite"][0] == np.inf


def test_states_given_to_a_step_are_not_changed() -> None:
    sample = SAMPLES["spring_damper_rk4"]()
    interpreter, log = Interpreter(sample.program), sample.log(30, 0)
    states = interpreter.start(log, [3, 4])
    before = {name: value.copy() for name, value in states.items()}
    interpreter.rollout(log, [3, 4], 5, states)
    for name, value in before.items():
        assert np.array_equal(states[name], value)

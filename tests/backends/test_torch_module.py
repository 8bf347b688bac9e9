"""The torch module computes what the interpreter computes, and its slopes are right at kinks."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
import torch

from backends.torch_module.module import TorchModel, build_module, gathered, physical_value
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import Relation
from compiler.ir.program import NodeId, Output, Parameter, Program, Role, Signal
from compiler.ir.types import Type
from compiler.passes.close_loop import close_loop
from compiler.passes.to_step_form import to_step_form
from tests.programs import SAMPLES, Sample

# Both sides round in float64 and may only add in another order.
TOLERANCE = 1e-12

FORMS = {
    "window": lambda sample: sample.program,
    "closed": lambda sample: close_loop(sample.program, sample.closed),
    "step": lambda sample: to_step_form(sample.program),
    "closed_step": lambda sample: to_step_form(close_loop(sample.program, sample.closed)),
}


def agree(found: torch.Tensor, expected: np.ndarray) -> None:
    scale = np.maximum(np.abs(expected), np.max(np.abs(expected), initial=1e-300))
    difference = np.abs(found.detach().numpy() - expected)
    assert found.shape == expected.shape
    assert np.all(difference <= TOLERANCE * scale), float(np.max(difference / scale))


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("name", SAMPLES)
def test_steps_agree_with_the_interpreter(name: str, form: str) -> None:
    sample: Sample = SAMPLES[name]()
    program = FORMS[form](sample)
    log = sample.log(60, 3)
    judge, model = Interpreter(program), build_module(program)
    t0 = np.array([6, 9, 20])
    tensors = {key: torch.from_numpy(value) for key, value in log.items()}
    states = judge.start(log, t0)
    for key, value in model.start(tensors, torch.from_numpy(t0)).items():
        agree(value, states[key])
    for k in range(30):
        expected = judge.step(log, t0 + k, states)
        given = {key: torch.from_numpy(value) for key, value in states.items()}
        found = model.step(tensors, torch.from_numpy(t0 + k), given)
        for key, value in found.outputs.items():
            agree(value, expected.outputs[key])
        for key, value in found.next_states.items():
            agree(value, expected.next_states[key])
        for key, (prediction, target) in found.losses.items():
            wanted, logged = expected.losses[key]
            agree(prediction, wanted)
            if target is not None:
                assert logged is not None
                agree(target, logged)
        states = expected.next_states


def test_bounded_parameters_come_back_as_they_were_given() -> None:
    model = build_module(SAMPLES["spring_damper_rk4"]().program)
    weights = {"mass": np.array(2.5), "damping": np.array(0.01), "stiffness": np.array(40.0)}
    assert model.load_physical(weights) == ()
    for name, value in weights.items():
        assert model.weights()[name] == value


def test_weights_on_a_bound_are_moved_off_it_and_named_where_they_are_trained() -> None:
    model = build_module(SAMPLES["spring_damper_rk4"]().program)
    weights = {"mass": np.array(10.0), "damping": np.array(0.0)}
    assert model.load_physical(weights, ["mass"]) == ("mass",)
    assert 9.99 < model.weights()["mass"] < 10.0
    assert model.weights()["damping"] == 0.0


def test_numbers_that_are_not_learned_are_no_variables() -> None:
    program = SAMPLES["spring_damper_rk4"]().program
    held = tuple(replace(p, learn=p.name != "damping") for p in program.parameters)
    model = build_module(replace(program, parameters=held))
    names = {p.name for p in held}
    assert {name for name, _ in model.named_parameters()} == names - {"damping"}
    # as it was given, bounds or none: no map to a raw variable and back
    damping = dict(model.named_buffers())["damping"]
    assert damping.numpy() == np.asarray(program.parameter("damping").initial)
    assert model.physical()["damping"] is damping


@pytest.mark.parametrize("x", [-40.0, -3.0, 0.0, 19.5, 20.5, 36.0])
def test_half_bounded_parameters_have_exact_tails(x: float) -> None:
    """torch's own softplus is a straight line from 20 on: off by 1e-9 there, in its slope too."""
    above = Parameter("p", initial=(1.0,), minimum=1.0, scale=2.0)
    below = Parameter("p", initial=(1.0,), maximum=1.0, scale=2.0)
    soft, slope = math.log1p(math.exp(x)), 2.0 / (1.0 + math.exp(-x))
    for parameter, raw, expected in (
        (above, x, 1.0 + 2.0 * soft),
        (below, -x, 1.0 - 2.0 * soft),
    ):
        variable = torch.tensor(raw, dtype=torch.float64, requires_grad=True)
        value = physical_value(parameter, variable)
        value.backward()
        assert value.item() == pytest.approx(expected, rel=1e-14)
        assert variable.grad is not None
        assert variable.grad.item() == pytest.approx(slope, rel=1e-14)


def slope_at(x: float, build: Callable[[GraphBuilder, NodeId], NodeId]) -> tuple[float, float]:
    """Value and slope of a scalar expression of one parameter."""
    b = GraphBuilder()
    node: NodeId = build(b, b.parameter("p", Type()))
    program = Program(
        "kink", None, (Signal("u", Role.INPUT),), (Parameter("p", initial=(x,)),), (),
        b.graph(), GraphBuilder().graph(), (Output("y", node),),
    )  # fmt: skip
    model = build_module(program)
    value = model.step({}, torch.tensor([0]), {}).outputs["y"].sum()
    value.backward()
    gradient = model.raw("p").grad
    assert gradient is not None
    return value.item(), gradient.item()


KINKS = {
    "abs at 0": (0.0, lambda b, p: b.apply("abs", p), 0.0),
    "sign at 0": (0.0, lambda b, p: b.apply("sign", p), 0.0),
    "tie of min goes to the first": (1.0, lambda b, p: b.minimum(p, b.constant(1.0)), 1.0),
    "tie of max goes to the first": (1.0, lambda b, p: b.maximum(b.constant(1.0), p), 0.0),
    "relu at 0": (0.0, lambda b, p: b.maximum(b.constant(0.0), p), 0.0),
    "clamp on its bound": (
        2.0, lambda b, p: b.clamp(p, b.constant(-1.0), b.constant(2.0)), 1.0
    ),
    "softplus at 0": (0.0, lambda b, p: b.apply("softplus", p), 0.5),
    "untaken sqrt": (
        -4.0,
        lambda b, p: b.select(
            b.compare(Relation.GREATER, p, b.constant(0.0)), b.apply("sqrt", p), b.negate(p)
        ),
        -1.0,
    ),
    "untaken division": (
        0.0,
        lambda b, p: b.select(
            b.compare(Relation.GREATER, p, b.constant(0.0)),
            b.multiply(p, b.divide(b.constant(1.0), p)),
            b.multiply(b.constant(3.0), p),
        ),
        3.0,
    ),
}  # fmt: skip


@pytest.mark.parametrize("kink", KINKS)
def test_slopes_at_kinks(kink: str) -> None:
    x, build, expected = KINKS[kink]
    assert slope_at(x, build)[1] == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize("operation", ["minimum", "maximum"])
@pytest.mark.parametrize("first", [True, False])
def test_nan_propagates_through_extrema(operation: str, first: bool) -> None:
    def build(b: GraphBuilder, p: NodeId) -> NodeId:
        pair = (p, b.constant(1.0)) if first else (b.constant(1.0), p)
        return getattr(b, operation)(*pair)

    assert np.isnan(slope_at(float("nan"), build)[0])


# what torch says of its own modules when it first loads its forward mode
@pytest.mark.filterwarnings("ignore::FutureWarning")
@pytest.mark.parametrize("name", SAMPLES)
def test_tangents_of_constants_change_no_bit_of_values_and_slopes(name: str) -> None:
    program = to_step_form(SAMPLES[name]().program)
    log = {key: torch.from_numpy(value) for key, value in SAMPLES[name]().log(60, 3).items()}
    model, t = build_module(program), torch.tensor([6, 9, 20])
    physical = {key: value.detach() for key, value in model.physical().items()}

    def computed(factor: torch.Tensor, *, given: bool) -> dict[str, torch.Tensor]:
        zero = torch.where(torch.tensor(False), factor, 0.0)
        with model.constants_with_tangents(zero) if given else nullcontext():
            frame = model.frame_of({key: factor * value for key, value in physical.items()})
            windows = gathered(log, t)
            found = model.step_on(windows, model.start_on(windows, frame, len(t)), frame, len(t))
        return {**found.outputs, **{f"next {key}": v for key, v in found.next_states.items()}}

    def both(*, given: bool) -> tuple[dict[str, torch.Tensor], dict[str, torch.Tensor]]:
        one = torch.tensor(1.0, dtype=torch.float64)
        slopes = torch.func.jacfwd(lambda factor: computed(factor, given=given))(one)
        return slopes, computed(one, given=False)

    plain = both(given=False)
    constants = [*map(id, _constants(model))]
    shifted = both(given=True)
    assert constants == [*map(id, _constants(model))]
    for wanted, found in zip(plain, shifted, strict=True):
        for key, value in wanted.items():
            np.testing.assert_array_equal(found[key].numpy(), value.numpy(), err_msg=key)


def _constants(model: TorchModel) -> list[torch.Tensor]:
    return [value for code in model._step.codes for value in code.module.buffers()]


def test_a_constant_keeps_the_sign_of_its_zero_while_it_has_a_tangent() -> None:
    builder = GraphBuilder()
    result = builder.divide(builder.constant(1.0), builder.constant(-0.0))
    outputs = (Output("y", result),)
    program = Program("zero", None, (), (), (), builder.graph(), GraphBuilder().graph(), outputs)
    model = build_module(program)
    with model.constants_with_tangents(torch.tensor(0.0, dtype=torch.float64)):
        values = model.step({}, torch.tensor([0]), {}).outputs["y"]
    assert values.item() == -np.inf

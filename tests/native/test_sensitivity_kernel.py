"""Kernels of sensitivities against the interpreter and against the reverse gradient."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from backends.gauss_newton_products import Products, joined_runs
from backends.native.kernel import Kernel
from backends.native.sensitivity_kernel import STACK, SensitivityKernel, with_stack
from compiler.differentiation.sensitivities import Sensitivities, sensitivities
from compiler.differentiation.sums_of_squares import with_compared_squares
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.program import Measure, Output, Program
from compiler.passes.close_loop import close_loop
from msnn.data.rollout_rows import Runs
from msnn.simulation.rollout import loss_sums
from tests.conditions import require_tool
from tests.language.compiled import compiled
from tests.native.test_kernel import MODELS, flat, initial, log_of

SQUARED = [name for name in MODELS if name != "classes"]
"""Cross-entropy is no sum of squares."""

Array = NDArray[np.float64]
Rows = NDArray[np.int64]


@pytest.fixture(autouse=True)
def _compiler() -> None:
    require_tool("gcc", install="apt install gcc")


def squared(name: str) -> Program:
    """A model whose losses are sums of squares, its loop closed."""
    text, closed = MODELS[name]
    program = close_loop(compiled(text.replace("mae(", "huber(")), closed)
    return with_compared_squares(program)


def interpreted(
    found: Sensitivities, log: Mapping[str, Array], t0: Rows, steps: int, skip: int
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Slopes (rows, learned numbers) and residuals (rows) of every loss, by the interpreter."""
    program = found.program
    judge = Interpreter(with_residuals(found))
    states = judge.start(log, t0)
    slopes: dict[str, list[Array]] = {loss.name: [] for loss in program.losses}
    values: dict[str, list[Array]] = {loss.name: [] for loss in program.losses}
    for number in range(steps):
        step = judge.step(log, t0 + number, states)
        states = step.next_states
        for name in slopes if number >= skip else ():
            slope = step.outputs[f"slopes of {name}"].reshape(len(t0), found.numbers, -1)
            slopes[name].append(slope.transpose(0, 2, 1).reshape(-1, found.numbers))
            values[name].append(step.outputs[f"residuals of {name}"].ravel())
    return (
        {name: np.concatenate(parts) for name, parts in slopes.items()},
        {name: np.concatenate(parts) for name, parts in values.items()},
    )


def with_residuals(found: Sensitivities) -> Program:
    outputs = [
        Output(f"{kind} of {one.loss.name}", node)
        for one in found.residuals
        for kind, node in (("slopes", one.slopes), ("residuals", one.values))
    ]
    return replace(found.program, outputs=tuple(outputs))


def native(
    found: Sensitivities, log: dict[str, Array], t0: Rows, steps: int, skip: int
) -> dict[str, Products]:
    kernel = SensitivityKernel(found)
    lengths = np.full(len(t0), steps)
    return kernel.products(
        kernel.data(log, skip), t0, lengths, flat(found.program, initial(found.program))
    )


@pytest.mark.parametrize("name", SQUARED)
@pytest.mark.parametrize("steps", [1, 12])
def test_products_are_those_of_the_interpreter(name: str, steps: int) -> None:
    program = squared(name)
    found = sensitivities(program, [p.name for p in program.parameters])
    log = log_of(program)
    t0 = np.arange(10, 31)  # 21 rollouts: a whole group of lanes and a part of one
    products = native(found, log, t0, steps, steps // 4)
    slopes, values = interpreted(found, log, t0, steps, steps // 4)
    for loss in program.losses:
        one, jacobian, residual = products[loss.name], slopes[loss.name], values[loss.name]
        # the same products, added in another order
        scale = max(float(np.abs(jacobian.T @ jacobian).max()), 1e-12)
        np.testing.assert_allclose(one.curvature, jacobian.T @ jacobian, atol=1e-12 * scale)
        np.testing.assert_allclose(one.slope, jacobian.T @ residual, atol=1e-12 * scale + 1e-12)
        assert one.squares == pytest.approx(residual @ residual, rel=1e-12)
        assert one.count == len(residual)


@pytest.mark.parametrize("name", SQUARED)
def test_the_slope_is_half_the_reverse_gradient(name: str) -> None:
    program = squared(name)
    found = sensitivities(program, [p.name for p in program.parameters])
    log = log_of(program)
    t0 = np.arange(10, 31)
    products = native(found, log, t0, 12, 3)
    kernel = Kernel(program, "float64")
    groups = kernel.groups(t0, np.full(len(t0), 12))
    weights = [0.0 if n not in products else 1.0 for n in kernel.source.losses]
    reverse = kernel.losses(kernel.data(log, 3), groups, flat(program, initial(program)), weights)
    forward = sum(2 * one.slope / one.count for one in products.values())
    scale = np.abs(reverse.gradient).max()
    np.testing.assert_allclose(forward, reverse.gradient, atol=1e-11 * scale)
    costs = [products[n].cost for n in kernel.source.losses]
    np.testing.assert_allclose(costs, reverse.sums, rtol=1e-12)


@pytest.mark.parametrize("name", ["fir", "arm", "memory", "vehicle"])
def test_segments_of_long_rollouts_join(name: str) -> None:
    """300 steps are three segments: nothing shows where they meet."""
    program = squared(name)
    found = sensitivities(program, [p.name for p in program.parameters])
    log = log_of(program, rows=340)
    t0 = np.array([10, 20, 25])
    products = native(found, log, t0, 300, 7)
    kernel = Kernel(program, "float64")
    groups = kernel.groups(t0, np.full(len(t0), 300))
    parameters = flat(program, initial(program))
    reverse = kernel.losses(kernel.data(log, 7), groups, parameters, [1.0])
    (one,) = products.values()
    scale = np.abs(reverse.gradient).max()
    np.testing.assert_allclose(2 * one.slope / one.count, reverse.gradient, atol=1e-10 * scale)


def test_some_parameters_and_missing_targets() -> None:
    program = compiled(
        "inputs: {u: N}\ntargets: {z: m}\nparameters: {a: 0.7, b: 0.1, c: 2}\n"
        'outputs: {y: {expr: "a * u + b * a * a + c", predicts: "z"}}'
    )
    for measure, delta in ((Measure.MSE, 1.0), (Measure.HUBER, 1.0), (Measure.HUBER, 0.25)):
        loss = replace(program.losses[0], measure=measure, delta=delta)
        one = replace(program, losses=(loss,))
        found = sensitivities(one, ["c", "a"])
        log = log_of(one)
        log["z"][::3] = np.nan
        log["z"] *= 4  # errors on both sides of huber's corner
        t0 = np.arange(0, 37)
        runs = Runs(t0, np.full(37, 2), 0, 0)
        (products,) = native(found, log, t0, 2, 0).values()
        slopes, values = interpreted(found, log, t0, 2, 0)
        jacobian, residual = slopes["y"], values["y"]
        np.testing.assert_allclose(products.curvature, jacobian.T @ jacobian, rtol=1e-12)
        np.testing.assert_allclose(products.slope, jacobian.T @ residual, rtol=1e-12)
        there = ~np.isnan(np.stack([log["z"][t0], log["z"][t0 + 1]]))
        assert products.count == there.sum()
        # twice the slope of the squares is the slope of the loss itself
        sums = [
            loss_sums(Interpreter(one, {**initial(one), name: np.array(value)}), log, runs)
            for name, start in (("c", 2.0), ("a", 0.7))
            for value in (start + 1e-6, start - 1e-6)
        ]
        above, below = ([each["y"].total for each in sums[side::2]] for side in (0, 1))
        central = (np.array(above) - np.array(below)) / 2e-6
        # an error of h² f‴/6, larger where a corner lies between the two, and of rounding, ε/h
        np.testing.assert_allclose(2 * products.slope, central, rtol=1e-5)
        if measure is Measure.MSE:
            assert products.squares == pytest.approx(products.cost, rel=1e-13)


@pytest.mark.parametrize("needed", [STACK, STACK + 1])
def test_what_runs_on_a_stack_of_its_own_raises_here(needed: int) -> None:
    """The exception of a thread that is only joined leaves sums of nothing."""

    def fail() -> None:
        raise MemoryError

    with pytest.raises(MemoryError):
        with_stack(needed, fail)


@pytest.mark.parametrize("name", SQUARED)
def test_products_of_runs_are_those_of_each_run_alone(name: str) -> None:
    """20 rollouts of three lengths in any order: full groups of lanes and ones that are not."""
    program = squared(name)
    found = sensitivities(program, [p.name for p in program.parameters if p.learn])
    kernel, log = SensitivityKernel(found), log_of(program, 60)
    random = np.random.default_rng(5)
    t0 = random.permutation(np.arange(10, 30))
    steps = random.choice([3, 7, 8], 20)
    data, physical = kernel.data(log, 2), flat(program, initial(program))
    together = kernel.products_of_runs(data, t0, steps, physical, 2)
    alone = [kernel.products(data, t0[[i]], steps[[i]], physical) for i in range(20)]
    for loss, one in together.items():
        right = joined_runs([run[loss] for run in alone], 2)
        assert right.count.sum() > 0
        np.testing.assert_array_equal(one.count, right.count)
        pairs = [(one.squares, right.squares), (one.cost, right.cost)]
        pairs += [(getattr(one.blocks, n), getattr(right.blocks, n)) for n in ("cross", "slope")]
        pairs += [(one.blocks.curvature, right.blocks.curvature)]
        pairs += [(getattr(one.all, n), getattr(right.all, n)) for n in ("curvature", "slope")]
        for value, expected in pairs:
            # sums in another order
            np.testing.assert_allclose(value, expected, rtol=1e-12, atol=1e-13)

"""Compares the graphs of training with difference quotients, with torch and with each other.

What the check of fresh kernels cannot find: a wrong derivative is as wrong in the kernel as in the
interpreter that it is compared with.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import torch

from backends.torch_module.module import build_module
from compiler.differentiation.interpreted_training import (
    InterpretedLosses,
    InterpretedTraining,
    interpreted_products,
)
from compiler.differentiation.sensitivities import sensitivities
from compiler.differentiation.sums_of_squares import is_sum_of_squares, with_compared_squares
from compiler.differentiation.training_step import training_step
from compiler.interpreter.interpreter import Interpreter
from compiler.interpreter.rounding import Rollouts
from compiler.ir.program import Program
from msnn.data.dataset import FloatArray, IntArray
from msnn.data.rollout_rows import Runs
from msnn.simulation.rollout import loss_sums
from msnn.training.engines.torch.torch_losses import batch_losses, scoring

Weights = Mapping[str, FloatArray]

_FIRST, _LAST = 1e-2, 1e-7
"""Steps of difference quotients, relative to the weights: a half each time."""

_TRUSTED = 1e-5
"""Of Σ|slope · direction|: a quotient that is no better known says nothing, and fails."""

_EXACT = 1e-9
"""Of the same: torch's slopes are exact as ours are, by other formulas in chains of operations."""


@dataclass(frozen=True, slots=True)
class Problem:
    """A program, its loops closed, at some rollouts and weights; losses count by their shares."""

    program: Program
    runs: Rollouts
    weights: Weights
    shares: Mapping[str, float]

    @property
    def as_runs(self) -> Runs:
        t0 = self.runs.t0
        return Runs(t0, np.full(len(t0), self.runs.steps), 0, 10**6)

    def total(self, weights: Weights) -> float:
        """The weighted total by the interpreter."""
        judge = Interpreter(self.program, weights)
        sums = loss_sums(judge, self.runs.log, self.as_runs, self.runs.skip)
        losses = self.program.losses
        return sum(self.shares[loss.name] * sums[loss.name].value(loss.measure) for loss in losses)


def problem(program: Program, log: Weights, t0: IntArray, steps: int, weights: Weights) -> Problem:
    """Scores all but the first step, at weights that are moved off 0, which hides slopes."""
    random = np.random.default_rng(8)
    moved = {
        p.name: np.clip(
            np.asarray(weights[p.name], float)
            + 0.05
            * np.where(np.equal(weights[p.name], 0), p.scale, weights[p.name])
            * random.uniform(-1, 1, np.shape(weights[p.name])),
            p.minimum,
            p.maximum,
        )
        for p in program.parameters
    }
    shares = {loss.name: 1.0 + 0.3 * i for i, loss in enumerate(program.losses)}
    return Problem(program, Rollouts(log, t0, steps, min(1, steps - 1)), moved, shares)


def assert_slopes_agree(p: Problem, directions: int = 3) -> None:
    """Raises AssertionError where reverse mode, forward mode, torch or differences disagree."""
    step = training_step(p.program)
    found = InterpretedTraining(step, p.weights, np.dtype(float)).losses(p.runs, p.shares)
    slopes = {name: np.asarray(one.value, float) for name, one in found.gradient.items()}
    rounded = {name: np.asarray(one.off(), float) for name, one in found.gradient.items()}
    _assert_like_torch(p, slopes, rounded)
    _assert_like_forward(p, slopes, rounded, found)
    for direction in _directions(p, directions):
        _assert_like_differences(p, slopes, direction, found)


def _directions(p: Problem, count: int) -> Iterator[Weights]:
    random = np.random.default_rng(4)
    for _ in range(count):
        yield {
            name: np.where(value == 0, 1.0, value)
            * random.uniform(0.5, 1.5, np.shape(value))
            * random.choice([-1.0, 1.0], np.shape(value))
            for name, value in p.weights.items()
        }


def _assert_like_differences(
    p: Problem, slopes: Weights, direction: Weights, found: InterpretedLosses
) -> None:
    addends = np.concatenate([(slopes[n] * d).ravel() for n, d in direction.items()] or [[0.0]])
    slope, size = float(addends.sum()), float(np.abs(addends).sum())
    off = sum(p.shares[name] * float(one.off()) for name, one in found.sums.items())
    step, before, best = _FIRST, None, np.inf
    while step > _LAST:
        sides = [
            p.total(
                {name: value + sign * step * direction[name] for name, value in p.weights.items()}
            )
            for sign in (1.0, -1.0)
        ]
        quotient = (sides[0] - sides[1]) / (2.0 * step)
        if before is not None:
            # twice the step has four times the error: the difference is three times what is left
            known = abs(quotient - before) + off / step
            best = min(best, known)
            if known <= _TRUSTED * size:
                assert abs(slope - quotient) <= known, (
                    f"slope {slope:.9g}, differences {quotient:.9g}"
                )
                return
        step, before = step / 2.0, quotient
    assert best <= max(_TRUSTED * size, 1e-9), f"differences say nothing: {best:.1e} of {size:.1e}"


def _assert_like_torch(p: Problem, slopes: Weights, rounded: Weights) -> None:
    module = build_module(p.program, torch.float64)
    leaves = {
        n: torch.tensor(v, dtype=torch.float64, requires_grad=True) for n, v in p.weights.items()
    }
    data = scoring(module, p.runs.log, p.runs.skip, None)
    sums = batch_losses(module, data, p.as_runs, module.frame_of(leaves))
    total = torch.zeros((), dtype=torch.float64)
    for loss in p.program.losses:
        total = total + p.shares[loss.name] * sums[loss.name].value(loss.measure)
    if not total.requires_grad:
        return
    grads = torch.autograd.grad(
        total, [*leaves.values()], allow_unused=True, materialize_grads=True
    )
    largest = max((float(np.abs(v).max(initial=0.0)) for v in slopes.values()), default=0.0)
    for name, grad in zip(leaves, grads, strict=True):
        allowed = _EXACT * largest + 20.0 * rounded[name]
        assert (np.abs(grad.numpy() - slopes[name]) <= allowed).all(), f"torch: slope in {name}"


def _assert_like_forward(
    p: Problem, slopes: Weights, rounded: Weights, found: InterpretedLosses
) -> None:
    if not all(is_sum_of_squares(p.program.step, loss) for loss in p.program.losses):
        return
    program = with_compared_squares(p.program)
    learned = [parameter.name for parameter in program.parameters]
    made = sensitivities(program, learned)
    products = interpreted_products(made, p.weights, p.runs)
    forward, off = np.zeros(made.numbers), np.zeros(made.numbers)
    for name, one in products.items():
        factor = 2.0 * p.shares[name] / max(float(found.counts[name].value), 1.0)
        forward += factor * one.products.value[:-1, -1]
        off += factor * one.products.off()[:-1, -1]
    reverse = np.concatenate([slopes[name].ravel() for name in learned])
    allowed = off + np.concatenate([rounded[name].ravel() for name in learned])
    assert (np.abs(forward - reverse) <= allowed).all(), "forward and reverse mode differ"

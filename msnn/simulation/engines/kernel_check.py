"""Compares new kernels with the reference interpreter: losses and gradients must agree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from backends.gauss_newton_products import Products, ProductsOfRuns
from backends.native.compile_kernel import Built
from backends.native.kernel import Kernel
from backends.native.sensitivity_kernel import SensitivityKernel
from backends.native.variables import by_parameter, flat
from compiler.differentiation.interpreted_training import InterpretedTraining, interpreted_products
from compiler.differentiation.sensitivities import Sensitivities
from compiler.interpreter.bounded import Total
from msnn.data.dataset import FloatArray
from msnn.data.starts import Runs
from msnn.simulation.engines.kernel_trials import Weights, cases, compare

_MORE = 3
"""Rollouts in addition to a full group of SIMD lanes, to test a partial group too."""


def check_kernel(kernel: Kernel, series: Weights, runs: Runs, weights: Weights) -> None:
    """Compares losses and gradients of a kernel with the interpreter's. Raises WrongKernelError."""
    # different weights: slopes of two losses that took each other's place would cancel in none
    shares = {name: 1.0 + 0.3 * i for i, name in enumerate(kernel.source.losses)}
    for case in cases(kernel.program, series, runs, weights, kernel.lanes + _MORE):
        few = case.runs
        groups = kernel.groups(few.t0, np.full(len(few.t0), few.steps))
        data = kernel.data(few.log, few.skip)
        physical, given = flat(kernel.program, case.weights), [*shares.values()]
        found = kernel.losses(data, groups, physical, given, gradient=kernel.slopes)
        right = InterpretedTraining(kernel.step, case.weights, kernel.dtype).losses(few, shares)
        for name, total, count in zip(shares, found.sums, found.counts, strict=True):
            _compare(kernel.built, f"the loss `{name}`", total, right.sums[name])
            _compare(kernel.built, f"the elements of `{name}`", count, right.counts[name])
        slopes = by_parameter(kernel.program, found.gradient) if kernel.slopes else {}
        for name, slope in slopes.items():
            _compare(kernel.built, f"the slope in `{name}`", slope, right.gradient[name])


def check_sensitivities(
    kernel: SensitivityKernel,
    found: Sensitivities,
    series: Weights,
    runs: Runs,
    weights: Weights,
) -> None:
    """Compares products of residuals and Jacobians like `check_kernel`."""
    for case in cases(found.program, series, runs, weights, kernel.lanes + _MORE):
        few = case.runs
        steps = np.full(len(few.t0), few.steps)
        physical = flat(found.program, case.weights)
        rollouts = (kernel.data(few.log, few.skip), few.t0, steps, physical)
        products = kernel.products(*rollouts)
        for name, one in interpreted_products(found, case.weights, few).items():
            of_kernel = products[name]
            _compare(kernel.built, f"the loss `{name}`", of_kernel.cost, one.cost)
            _compare(kernel.built, f"the elements of `{name}`", of_kernel.count, one.count)
            left_out = f"the elements left out of `{name}`"
            _compare(kernel.built, left_out, of_kernel.left_out, one.left_out)
            _compare(
                kernel.built,
                f"the slopes and residuals of `{name}`",
                _joined(of_kernel),
                one.products,
            )
        # those of the second group of lanes, which must not stand among those of the first
        last = slice(kernel.lanes, None)
        apart = kernel.products_of_runs(*rollouts, own=kernel.numbers)
        second = replace(few, t0=few.t0[last])
        for name, one in interpreted_products(found, case.weights, second).items():
            slopes_of = f"the slopes and residuals of `{name}` by rollout"
            _compare(kernel.built, slopes_of, _joined(_summed(apart[name], last)), one.products)


def _compare(built: Built, what: str, found: FloatArray | float, right: Total) -> None:
    compare(built, what, found, right.value, right.off())


def _joined(one: Products) -> FloatArray:
    """[J r]ᵀ[J r]."""
    last = np.array([[one.squares]])
    return np.block([[one.curvature, one.slope[:, None]], [one.slope[None, :], last]])


def _summed(runs: ProductsOfRuns, some: slice) -> Products:
    """The summed products of some runs, in which every variable belongs to one run."""
    return Products(
        curvature=runs.blocks.curvature[some].sum(axis=0),
        slope=runs.blocks.slope[some].sum(axis=0),
        squares=float(runs.squares[some].sum()),
        cost=float(runs.cost[some].sum()),
        count=float(runs.count[some].sum()),
    )

"""Compares new kernels with the reference interpreter, on a few short rollouts.

Both run the same graphs in the same precision. Values may differ by rounding only, and the rounding
error is bounded along the computation (decision 0180). A correct kernel therefore passes for any
model and data.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from backends.files.disk_arrays import AT_ONCE
from backends.gauss_newton_products import Products, ProductsOfRuns
from backends.native.compile_kernel import Built
from backends.native.kernel import Kernel
from backends.native.sensitivity_kernel import SensitivityKernel
from backends.native.variables import by_parameter, flat
from compiler.differentiation.interpreted_training import InterpretedTraining, interpreted_products
from compiler.differentiation.sensitivities import Sensitivities
from compiler.interpreter.bounded import Total
from compiler.interpreter.rounding import Rollouts
from compiler.ir.nodes import needed
from compiler.ir.ops import Clamp, Compare, Constant, Maximum, Minimum, ReadSignal
from compiler.ir.program import Program, Role
from msnn.data.dataset import BoolArray, FloatArray, IntArray
from msnn.data.rollout_rows import Runs, reach

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
    """Compares JᵀJ and Jᵀr of a kernel with the interpreter's. Raises WrongKernelError."""
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
    """The matrix [J r]ᵀ[J r], so that one comparison covers JᵀJ, Jᵀr and rᵀr."""
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


NO_FALLBACK = "MSNN_NO_FALLBACK"
"""The variable that turns every internal error into an exception; the test suite sets it."""

_AS_GIVEN = 4
"""Steps of the rollouts on the original data."""

LONGEST = 10
"""Steps of the rollouts on shuffled rows: kernels process eight steps at once, then single ones."""

_GAP = 3
"""One in this many targets is removed from the shuffled rows."""

_MOVED, _BESIDE = 0.3, 0.05
"""Fraction of values moved next to a threshold, and their maximum distance relative to the data's
span.
"""

_NEARBY = 0.05
"""Relative distance within which weights are varied, so that the model's behaviour is preserved."""

Weights = Mapping[str, FloatArray]


class WrongKernelError(Exception):
    """Losses or gradients of a kernel are wrong, which is a bug of msnn."""


@dataclass(frozen=True, slots=True)
class Case:
    """One test of a kernel: a few rollouts and the weights at which they are computed."""

    runs: Rollouts
    weights: Weights


def check_if_fresh(built: Built, check: Callable[[], None]) -> None:
    """Checks a kernel that has not been checked since it was built."""
    if not built.is_checked:
        check()
        built.mark_checked()


def cases(
    program: Program, series: Weights, runs: Runs, weights: Weights, members: int
) -> Iterable[Case]:
    """The tests of a kernel: a few rollouts at the weights, and on shuffled rows at nearby weights.

    With a well-fitted model, residuals of the first are only rounding errors. Shuffled rows have
    residuals as large as the signals.
    """
    series, runs = _first_rows(program, series, runs)
    # a seed of its own: a kernel that is wrong is found wrong by everybody
    random = np.random.Generator(np.random.Philox(180))
    longest = int(runs.steps.max())
    for wanted, drawn in ((_AS_GIVEN, False), (LONGEST, True)):
        steps = min(wanted, longest)
        starts = runs.t0[runs.steps >= steps]
        # with repetition: a kernel fills all its lanes, however few runs the data have
        t0 = np.sort(random.choice(starts, members))
        few = Rollouts(series, t0, steps, skip=min(1, steps - 1))
        if drawn:
            log = _without_some_targets(program, _drawn_rows(program, series, random), t0)
            few = replace(few, log=log)
        yield Case(few, nearby(program, weights, random) if drawn else weights)


def _first_rows(program: Program, series: Weights, runs: Runs) -> tuple[Weights, Runs]:
    """The first block of data that are larger than memory, and the runs within it."""
    rows, far = len(next(iter(series.values()))), reach(program)
    ends = runs.t0 + runs.steps + max(far.ahead, far.start_ahead)
    early = np.flatnonzero(ends < AT_ONCE)
    if rows <= AT_ONCE or not len(early):
        return series, runs
    return {name: values[:AT_ONCE] for name, values in series.items()}, runs.take(early)


def _drawn_rows(program: Program, series: Weights, random: np.random.Generator) -> Weights:
    """The data with rows drawn at random from those without missing inputs."""
    rows = len(next(iter(series.values())))
    whole = np.ones(rows, bool)
    for signal in program.signals:
        if signal.role is Role.INPUT and signal.name in series:
            # the state of a rollout is not finite after a row without an input, and nothing could
            # be compared
            whole &= np.isfinite(series[signal.name]).reshape(rows, -1).all(axis=1)
    among = np.flatnonzero(whole) if whole.any() else np.arange(rows)
    chosen = random.choice(among, rows)
    knots = _knots(program)
    return {name: _some_near(knots, values[chosen], random) for name, values in series.items()}


def _knots(program: Program) -> FloatArray:
    """The constants of a step with which values are compared."""
    # corners of min, max, clamp and comparisons: kernels choose a branch there
    compared = [
        arg
        for _, node in program.step
        if isinstance(node.op, Compare | Minimum | Maximum | Clamp)
        for arg in node.args
    ]
    marked = needed(program.step, compared)
    ops = (node.op for index, node in program.step if marked[index])
    numbers = {x for op in ops if isinstance(op, Constant) for x in op.values}
    return np.array(sorted(x for x in numbers if np.isfinite(x)))


def _some_near(knots: FloatArray, values: FloatArray, random: np.random.Generator) -> FloatArray:
    """The values, some of them moved close to a threshold within their range.

    The original rows may never distinguish a correct threshold from a slightly wrong one.
    """
    known = values[np.isfinite(values)]
    low, high = (known.min(), known.max()) if known.size else (0.0, 0.0)
    # numbers that the data never reach decide nothing
    inside = knots[(knots > low) & (knots < high)]
    if not inside.size:
        return values
    beside = random.choice(inside, values.shape)
    beside = beside + _BESIDE * (high - low) * random.uniform(-1.0, 1.0, values.shape)
    moved = np.isfinite(values) & (random.random(values.shape) < _MOVED)
    return np.where(moved, np.clip(beside, low, high), values)


def _without_some_targets(program: Program, log: Weights, t0: IntArray) -> Weights:
    """The data with gaps in values that only losses read, to test the handling of missing
    targets.
    """
    read = {node.op.signal for _, node in program.step if isinstance(node.op, ReadSignal)}
    around = reach(program)
    # a state that begins at NaN would stay there
    begun = np.arange(-around.back, around.start_ahead + 1)
    gaps = np.ones(len(next(iter(log.values()))), bool)
    gaps[(t0[:, None] + begun).ravel()] = False  # what the start reads
    gaps[np.arange(len(gaps)) % _GAP != 0] = False
    return {
        name: values if name in read else _with_gaps(values, gaps) for name, values in log.items()
    }


def _with_gaps(values: FloatArray, gaps: BoolArray) -> FloatArray:
    found = np.array(values, float)
    found[gaps] = np.nan
    return found


def nearby(program: Program, weights: Weights, random: np.random.Generator) -> Weights:
    """Weights near the given ones, within their bounds.

    A zero changes, too, unless a bound keeps it at 0.
    """
    found: dict[str, FloatArray] = {}
    for parameter in program.parameters:
        value = np.asarray(weights[parameter.name], float)
        # relative to a weight of 0 nothing is near
        size = np.where(value == 0.0, parameter.scale, value)
        moved = value + _NEARBY * size * random.uniform(-1.0, 1.0, value.shape)
        # beyond their bounds weights mean nothing to a program
        low = -np.inf if parameter.minimum is None else parameter.minimum
        high = np.inf if parameter.maximum is None else parameter.maximum
        found[parameter.name] = np.clip(moved, low, high)  # numpy 1 takes no two None
    return found


def compare(
    built: Built,
    what: str,
    found: FloatArray | float,
    right: FloatArray | float,
    off: FloatArray | float,
) -> None:
    """Raises WrongKernelError if a difference exceeds the bound of rounding errors.

    The bound is twice `off`, because both values may have that error. A value without a bound, e.g.
    after overflow, is not compared.
    """
    values, expected = np.asarray(found, float), np.asarray(right, float)
    with np.errstate(invalid="ignore"):
        allowed = np.broadcast_to(2.0 * np.asarray(off), expected.shape)
        # which of NaN and ±∞ it is can depend on the order of operations
        alike = ~np.isfinite(values) & ~np.isfinite(expected)
        wrong = ~(np.abs(values - expected) <= allowed) & np.isfinite(allowed) & ~alike
    if wrong.any():
        place = np.unravel_index(int(np.argmax(wrong)), wrong.shape)
        what = f"{what} {values[place]:.9g} instead of {expected[place]:.9g}"
        explained = f"where rounding explains {allowed[place]:.1g}"
        raise WrongKernelError(said(built, f"{what}, {explained}"))


def said(built: Built, what: str) -> str:
    """The message of a wrong kernel; `what` are the wrong values."""
    return f"kernel {built.name} computes {what}"

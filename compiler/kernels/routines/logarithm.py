"""ln x; comparisons and exact scaling find the exponent."""

from __future__ import annotations

import math

from compiler.kernels.routines.double_word import polynomial
from compiler.kernels.tables.coefficients import LN_2, LOGARITHM
from compiler.kernels.trace.operations import branch, select
from compiler.kernels.trace.subroutine import Subroutine
from compiler.kernels.trace.values import Real, Value


def normalise(x: Real) -> tuple[Real, Real]:
    """m, e with x = m·2^e exactly, 1 ≤ m < 2, e an integer, for finite x ≥ 1."""
    # portable C cannot read the bits of a float, so compare and scale
    mantissa = x
    parts: list[Real] = []
    step = x.format.overflow_exponent // 2
    while step >= 1:
        large = mantissa >= 2.0**step
        mantissa = mantissa * select(large, 2.0**-step, 1.0)
        parts.append(select(large, float(step), 0.0))
        step //= 2
    exponent = parts[0]
    for part in parts[1:]:
        exponent = exponent + part
    return mantissa, exponent


def reduce_logarithm(x: Real) -> tuple[Real, Real]:
    """f, e with x = (1 + f)·2^e exactly, √½ ≤ 1 + f < √2, for finite x > 0, also subnormal x."""
    # two steps scale every positive number below 1 into the range of `normalise`
    half = x.format.overflow_exponent // 2
    lift = float(-x.format.smallest_exponent - half)
    very_small = x < 2.0**-half
    lifted = x * select(very_small, 2.0**lift, 1.0)
    small = x < 1.0
    lifted = lifted * select(small, 2.0**half, 1.0)
    offset = select(very_small, lift, 0.0) + select(small, float(half), 0.0)
    mantissa, exponent = normalise(lifted)
    upper = mantissa > math.sqrt(2.0)
    mantissa = mantissa * select(upper, 0.5, 1.0)
    exponent = (exponent + select(upper, 1.0, 0.0)) - offset
    return (mantissa - 1.0).named("f"), exponent


def log_1p_rest(f: Real, addend: Real) -> Real:
    """log(1 + f) + addend − f for −0.3 < f < 0.4143, addend small.

    With s = f/(2 + f), h = f²/2 and log((1+s)/(1−s)) = 2s + s·R this is s·(h + R) − h.
    """
    s = f / (2.0 + f)
    square = s * s
    half_square = 0.5 * f * f
    ratio = square * polynomial(square, LOGARITHM[f.format])
    return (s * (half_square + ratio) + addend) - half_square


def _log(x: Real) -> tuple[Value, ...]:
    ln_2_high, ln_2_low = LN_2[x.format]

    def inside() -> Real:
        f, exponent = reduce_logarithm(x)
        # add the small parts first: only the sum with the largest part rounds significantly
        return exponent * ln_2_high + (log_1p_rest(f, exponent * ln_2_low) + f)

    def not_finite_positive() -> Real:
        # −∞ at ±0; 0/0 is NaN below; +∞ and NaN stay
        return branch(
            x <= 0.0,
            lambda: branch(x < 0.0, lambda: (x - x) / (x - x), lambda: -1.0 / abs(x), "low"),
            lambda: x,
            "special",
        )

    finite_positive = (x > 0.0) & (x <= x.format.largest)
    return (branch(finite_positive, inside, not_finite_positive, "result"),)


LOG = Subroutine("log", ("x",), "Natural logarithm.", _log)

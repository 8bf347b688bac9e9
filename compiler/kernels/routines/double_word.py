"""Arithmetic on pairs of reals whose exact sum is the value (double words), and the exact errors of
+ and ×.

Algorithms of T. J. Dekker, "A floating-point technique for extending the available precision",
Numerische Mathematik 18 (1971), and D. E. Knuth's two-sum.
"""

from __future__ import annotations

from collections.abc import Sequence

from compiler.kernels.trace.values import Real


def polynomial(x: Real, coefficients: Sequence[float]) -> Real:
    """c₀ + x·(c₁ + x·(c₂ + …)) by Horner's rule, with the `coefficients` c₀, c₁, …, at
    least two.
    """
    total = x * coefficients[-1] + coefficients[-2]
    for coefficient in reversed(coefficients[:-2]):
        total = total * x + coefficient
    return total


def ordered_sum(larger: Real, smaller: Real) -> tuple[Real, Real]:
    """Returns the rounded sum larger + smaller and its exact rounding error. Requires |larger| ≥
    |smaller| or larger = 0.
    """
    # Dekker's fast two-sum (1971)
    total = larger + smaller
    return total, smaller - (total - larger)


def exact_sum(a: Real, b: Real) -> tuple[Real, Real]:
    """Returns the rounded sum a + b and its exact rounding error. Either may be the larger one."""
    total = a + b
    # Knuth's two-sum: six operations and no comparison of sizes
    part = total - a
    return total, (a - (total - part)) + (b - part)


def split(x: Real) -> tuple[Real, Real]:
    """Returns two reals with half the significant bits each, whose exact sum is x; the larger comes
    first. x must be far below overflow.
    """
    shift = (x.format.digits + 1) // 2
    # Veltkamp's splitting
    scaled = x * (2.0**shift + 1.0)
    high = scaled - (scaled - x)
    return high, x - high


def exact_product(a: Real, b: Real) -> tuple[Real, Real]:
    """Returns the rounded product a·b and its rounding error, which is exact unless it is
    subnormal.
    """
    product = a * b
    a_high, a_low = split(a)
    b_high, b_low = split(b)
    # Dekker's product: each of the four is exact, and so is each sum in this order
    rest = ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low
    return product, rest


def reciprocal(high: Real, low: Real) -> Real:
    """1 / (high + low), with an error little above the rounding of the result, for |low| ≤
    ulp(high)/2.

    A quotient q cut to half the digits makes 1 − q·high exact, so that only the last sum q + q·rest
    rounds significantly.
    """
    quotient = 1.0 / high
    short, _ = split(quotient)
    high_1, high_2 = split(high)
    rest = ((1.0 - short * high_1) - short * high_2) - short * low
    return short + quotient * rest

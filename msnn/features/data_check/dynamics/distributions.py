"""Tail probabilities of statistical tests, accurate for tiny values too."""

from __future__ import annotations

import math

_TINY = 1e-300
_MOST_TERMS = 500


def f_survival(ratio: float, numbers: int, freedom: float) -> float:
    """P(F > `ratio`) for F with (`numbers`, `freedom`) degrees of freedom.

    P = I_x(freedom/2, numbers/2) with x = freedom/(freedom + numbers·ratio) (Abramowitz and Stegun
    26.6.2).
    """
    if ratio <= 0:
        return 1.0
    x = freedom / (freedom + numbers * ratio)
    return _incomplete_beta(
        x, numbers * ratio / (freedom + numbers * ratio), freedom / 2, numbers / 2
    )


def _incomplete_beta(x: float, rest: float, a: float, b: float) -> float:
    """I_x(a, b) with rest = 1 − x, by its continued fraction (Abramowitz and Stegun 26.5.8)."""
    if x <= 0 or rest <= 0:
        return 0.0 if x <= 0 else 1.0
    if x > (a + 1) / (a + b + 2):
        return 1.0 - _incomplete_beta(rest, x, b, a)
    log = math.lgamma(a + b) - math.lgamma(a) - math.lgamma(b)
    log += a * math.log(x) + b * math.log(rest)
    # Lentz's evaluation of the fraction
    value, above, below = 1.0, 1.0, 0.0
    for term in range(_MOST_TERMS):
        half = term // 2
        if term == 0:
            part = 1.0
        elif term % 2 == 0:
            part = half * (b - half) * x / ((a + 2 * half - 1) * (a + 2 * half))
        else:
            part = -(a + half) * (a + b + half) * x / ((a + 2 * half) * (a + 2 * half + 1))
        below = 1.0 / _away_from_zero(1.0 + part * below)
        above = _away_from_zero(1.0 + part / above)
        value *= above * below
        if term and abs(above * below - 1.0) < 1e-15:
            break
    return min(math.exp(log) * (value - 1.0) / a, 1.0) if log > -745 else 0.0


def _away_from_zero(value: float) -> float:
    return value if abs(value) > _TINY else _TINY

"""sigmoid and softplus, from the reduced exponential."""

from __future__ import annotations

from collections.abc import Callable

from compiler.kernels.routines.double_word import exact_sum, ordered_sum, reciprocal
from compiler.kernels.routines.exponential import EXP, reduce_exponential, small_power_of_two
from compiler.kernels.routines.logarithm import log_1p_rest
from compiler.kernels.tables.coefficients import LN_2
from compiler.kernels.tables.formats import Format
from compiler.kernels.trace.operations import branch, constant, select
from compiler.kernels.trace.subroutine import Subroutine, call
from compiler.kernels.trace.values import Real, Value


def _limit(format: Format) -> float:
    """The limit beyond which e^−|x| is less than 1/16 of the last digit of 1."""
    return (format.digits + 3.0) * 0.6931471805599453


def _outside(x: Real, above: Callable[[], Real]) -> Real:
    """The value for |x| beyond the limit: e^x for x < 0, elsewhere above(), which receives NaN."""
    return branch(x < 0.0, lambda: call(EXP, x), above, "outside")


def _sigmoid(x: Real) -> tuple[Value, ...]:
    largest_count = x.format.digits + 4
    size = abs(x).named("size")

    def inside() -> Real:
        # 1/(1 + e^|x|) with a denominator of two words: (power + 1) + power·s
        count, s, rest = reduce_exponential(size)
        power = small_power_of_two(count, largest_count).named("power")
        whole, lost = ordered_sum(power, constant(x, 1.0))
        high, low = ordered_sum(whole, power * s)
        small = reciprocal(high, low + (lost + power * rest)).named("small")
        return select(x < 0.0, small, 1.0 - small)

    def one() -> Real:
        return select(x > 0.0, 1.0, x)

    return (branch(size <= _limit(x.format), inside, lambda: _outside(x, one), "result"),)


def _softplus(x: Real) -> tuple[Value, ...]:
    largest_count = x.format.digits + 4
    ln_2 = sum(LN_2[x.format])
    size = abs(x).named("size")

    def inside() -> Real:
        # max(x, 0) + log(1 + e), e = e^−|x| in two words
        count, s, rest = reduce_exponential(-size)
        power = 1.0 / small_power_of_two(-count, largest_count)
        whole = 1.0 + s
        e = (power * whole).named("e")
        e_low = power * ((s - (whole - 1.0)) + rest)
        # log(1 + e) = log 2 + log(1 + (e − 1)/2) for the larger e
        large = e > 0.4142
        f_large, f_low = exact_sum(e, constant(x, -1.0))
        f = select(large, 0.5 * f_large, e)
        f_rest = select(large, 0.5 * (f_low + e_low), e_low)
        base = select(x > 0.0, x, 0.0)
        tail = log_1p_rest(f, f_rest / (1.0 + f)).named("tail")
        total = base + (f + tail)
        return select(large, total + ln_2, total)

    return (branch(size <= _limit(x.format), inside, lambda: _outside(x, lambda: x), "result"),)


SIGMOID = Subroutine("sigmoid", ("x",), "1 / (1 + e^−x).", _sigmoid)
SOFTPLUS = Subroutine("softplus", ("x",), "log(1 + e^x).", _softplus)

"""The kernels sin, cos and tan of every finite angle in rad."""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

from compiler.kernels.routines.double_word import exact_product, ordered_sum, polynomial, reciprocal
from compiler.kernels.routines.exponential import normalise, round_to_integer
from compiler.kernels.routines.hyperbolic import tiny, with_sign_of
from compiler.kernels.tables.coefficients import (
    COSINE,
    HALF_PI,
    HALF_PI_PARTS,
    SINE,
    TANGENT,
    TWO_OVER_PI,
    TWO_OVER_PI_WORDS,
)
from compiler.kernels.tables.formats import Format
from compiler.kernels.trace.statements import Table, ValueKind
from compiler.kernels.trace.values import (
    Real,
    Subroutine,
    Unsigned,
    Value,
    branch,
    branch_tuple,
    constant,
    look_up_word,
    select,
    select_word,
    to_kind,
    to_real,
    to_unsigned,
)


def _sine(high: Real, low: Real) -> Real:
    """sin(high + low) for |high| ≤ π/4 and a small low: high + (high·z·P(z) + low·(1 − z/2)) with z
    = high² and the polynomial P of `SINE`.
    """
    square = high * high
    cubic = high * (square * polynomial(square, SINE[high.format]))
    return high + (cubic + (low - 0.5 * square * low))


def _cosine(high: Real, low: Real) -> Real:
    """cos(high + low) for |high| ≤ π/4 and a small low: 1 − z/2 + (z²·P(z) − high·low) with z =
    high² and the polynomial P of `COSINE`.
    """
    square = high * high
    half = 0.5 * square
    whole = 1.0 - half
    rest = square * square * polynomial(square, COSINE[high.format])
    # (1 − whole) − z/2 is exactly the rounding error of `whole`
    return whole + (((1.0 - whole) - half) + (rest - high * low))


def _tangent(high: Real, low: Real) -> tuple[Real, Real]:
    """tan(high + low) for |high| ≤ π/4 and a small low, as a rounded value and its remainder."""
    cubic = _tangent_beyond(high)
    slope = 1.0 + (high + cubic) * (high + cubic)
    return ordered_sum(high, cubic + low * slope)


def _tangent_beyond(x: Real) -> Real:
    """tan(x) − x for |x| ≤ π/4, as x·z·P(z) with z = x² and the polynomial P of `TANGENT`."""
    square = x * x
    return x * (square * polynomial(square, TANGENT[x.format]))


def _sin(x: Real) -> tuple[Value, ...]:
    size = abs(x).named("size")

    def general() -> Real:
        high, low, quadrant = reduce_angle(size)
        odd = (quadrant & 1) > 0
        value = branch(odd, lambda: _cosine(high, low), lambda: _sine(high, low), "value")
        return with_sign_of(x, select((quadrant & 2) > 0, -value, value))

    return (_finite_odd(x, size, general),)


def _cos(x: Real) -> tuple[Value, ...]:
    size = abs(x).named("size")

    def general() -> Real:
        high, low, quadrant = reduce_angle(size)
        odd = (quadrant & 1) > 0
        value = branch(odd, lambda: _sine(high, low), lambda: _cosine(high, low), "value")
        # negative in the quadrants 1 and 2
        return select(((quadrant + 1) & 2) > 0, -value, value)

    # ∞ − ∞ and NaN − NaN are NaN
    return (branch(size <= x.format.largest, general, lambda: x - x, "result"),)


def _tan(x: Real) -> tuple[Value, ...]:
    size = abs(x).named("size")

    def general() -> Real:
        high, low, quadrant = reduce_angle(size)
        odd = (quadrant & 1) > 0

        def direct() -> Real:
            tangent, rest = _tangent(high, low)
            return branch(odd, lambda: -reciprocal(tangent, rest), lambda: tangent + rest, "direct")

        def from_diagonal() -> Real:
            # tan(π/4 − w) = 1 − 2t/(1 + t), its inverse 1 + 2t/(1 − t), t = tan w
            word, rest = (0.5 * part for part in HALF_PI[x.format])
            remaining = (word - abs(high)) + (rest - with_sign_of(high, low))
            tangent = remaining + _tangent_beyond(remaining)
            signed = select(odd, -tangent, tangent)
            value = with_sign_of(high, 1.0 - (signed + signed) / (1.0 + signed))
            return select(odd, -value, value)

        # near π/4 the rounding error of the cubic term is significant
        value = branch(abs(high) < 0.67, direct, from_diagonal, "value")
        return with_sign_of(x, value)

    return (_finite_odd(x, size, general),)


def _finite_odd(x: Real, size: Real, general: Callable[[], Real]) -> Real:
    """x if |x| (`size`) is tiny, NaN if it is infinite or NaN, else `general()`."""
    return branch(
        size < tiny(x.format),
        lambda: x,
        lambda: branch(size <= x.format.largest, general, lambda: x - x, "value_or_nan"),
        "result",
    )


SIN = Subroutine("sin", ("x",), "Sine of an angle in rad.", _sin)
COS = Subroutine("cos", ("x",), "Cosine of an angle in rad.", _cos)
TAN = Subroutine("tan", ("x",), "Tangent of an angle in rad.", _tan)


_RESULTS = ("high", "low", "quadrant")


def _largest_count(x: Real) -> float:
    """Maximum number of quarter turns whose product with the first part of π/2 is exact, in the
    format of x.
    """
    return 2.0**7 if x.format.digits == 24 else 2.0**10


def _reduce_small(x: Real) -> tuple[Value, ...]:
    """Returns high, low and quadrant as `reduce_angle`, for angles up to 2^7 (float) or 2^10
    (double) quarter turns: x − count·π/2 after W. J. Cody and W. Waite, with π/2 in three words.
    """
    first, second, third = HALF_PI_PARTS[x.format]
    count = round_to_integer(x * TWO_OVER_PI[x.format][0]).named("count")
    # exact: the first part of π/2 is short enough for this number of quarter turns
    near = (x - count * first).named("closer")
    part = (count * second).named("part")
    difference = (near - part).named("difference")
    rest = ((near - difference) - part) - count * third
    high, low = ordered_sum(difference, rest)
    return high, low, to_unsigned(count) & 3


def _reduce(x: Real) -> tuple[Value, ...]:
    limit = _largest_count(x) / TWO_OVER_PI[x.format][0]
    return branch_tuple(x < limit, lambda: _reduce_small(x), lambda: reduce_huge(x), _RESULTS)


REDUCE_ANGLE = Subroutine(
    "reduce_angle",
    ("x",),
    "Finite x >= 0 as quadrant * pi/2 + high + low, |high| <= pi/4; the quadrant modulo 4.",
    _reduce,
    results=_RESULTS,
)


def reduce_angle(x: Real) -> tuple[Real, Real, Unsigned]:
    """Returns high, low and quadrant (0 … 3) with x ≡ quadrant·π/2 + high + low (mod 2π) and |high|
    ≤ π/4, for finite x ≥ 0.
    """
    high, low, quadrant = REDUCE_ANGLE(x)
    return cast(Real, high), cast(Real, low), cast(Unsigned, quadrant)


def reduce_huge(x: Real) -> tuple[Value, ...]:
    """Returns high, low and quadrant as `reduce_angle`, for finite x from 2^7 (float) or 2^10
    (double) on: multiplies x by enough binary digits of 2/π.
    """
    mantissa, exponent = _integer_mantissa(x)
    # words of the fraction that are kept: a float's product needs fewer than a double's
    kept = 2 if len(mantissa) == 1 else 4
    words = _aligned_words(exponent, kept + len(mantissa), x.format)
    digits = _product_fraction(mantissa, words)
    # half a quarter turn added, the two leading bits are the nearest quadrant
    shifted = digits[0] + 0x20000000
    quadrant = shifted >> 30
    # a quarter turn is 2^30; less the half of one added above, this is the signed rest
    turned = shifted & 0x3FFFFFFF
    negative = turned < 0x20000000
    # the complement of the digits negates the fraction but for one unit of the last digit
    magnitude = [select_word(negative, 0x1FFFFFFF - turned, turned - 0x20000000)]
    magnitude += [select_word(negative, 0xFFFFFFFF - digit, digit) for digit in digits[1:]]
    fraction, fraction_rest = _sum_digits(magnitude, x.format)
    half_pi, half_pi_rest = HALF_PI[x.format]
    product, lost = exact_product(fraction, constant(x, half_pi))
    lost = lost + (fraction * half_pi_rest + fraction_rest * half_pi)
    high, low = ordered_sum(product, lost)
    return select(negative, -high, high), select(negative, -low, low), quadrant


def _leading_zeros(format: Format) -> int:
    """Number of zero words in front of the words of 2/π, so that the index into them is ≥ 0 for the
    smallest exponent.
    """
    return 1 if format.digits == 24 else 2


def _integer_mantissa(x: Real) -> tuple[list[Unsigned], Unsigned]:
    """Returns the 32-bit digits of the integer significand of x, lowest first, and a bit position:
    that of the first relevant bit of 2/π, counted with the zero words in front.
    """
    fraction, exponent = normalise(x)
    digits = x.format.digits
    position = to_unsigned(exponent + (32.0 * _leading_zeros(x.format) - digits - 1.0))
    if digits <= 32:
        return [to_unsigned(fraction * 2.0 ** (digits - 1))], position
    scaled = fraction * 2.0 ** (digits - 33)
    upper = to_unsigned(scaled)
    lower = to_unsigned((scaled - to_real(upper)) * 2.0**32)
    return [lower, upper], position


def _aligned_words(position: Unsigned, count: int, format: Format) -> list[Unsigned]:
    """`count` words of 32 bits out of the leading zero words and the binary digits of 2/π,
    beginning at the bit `position`.
    """
    leading = _leading_zeros(format)
    last = (32 * leading + format.overflow_exponent - 1 - format.digits - 1) // 32 + count
    entries = ((0,) * leading + TWO_OVER_PI_WORDS)[: last + 1]
    table = Table("two_over_pi", ValueKind.UNSIGNED, entries)
    # bits to words of 32 bits: which word, and how far into it
    index = position >> 5
    shift = to_kind(position & 31, ValueKind.WIDE)
    words = [look_up_word(table, index)]
    words += [look_up_word(table, index + i) for i in range(1, count + 1)]
    aligned: list[Unsigned] = []
    for i in range(count):
        # two words side by side, shifted to the first bit that matters
        pair = (to_kind(words[i], ValueKind.WIDE) << 32) | to_kind(words[i + 1], ValueKind.WIDE)
        aligned.append(to_kind((pair << shift) >> 32, ValueKind.UNSIGNED))
    return aligned


def _product_fraction(mantissa: list[Unsigned], words: list[Unsigned]) -> list[Unsigned]:
    """The leading 32-bit digits of the fraction of Σ mᵢ·2^(32 i) × Σ wⱼ·2^(−32(j+1)), with mᵢ from
    `mantissa` (lowest first) and wⱼ from `words`.

    The number of digits is that of `words` minus that of `mantissa`. The truncation error is below
    2 units of the last digit.
    """
    kept = len(words) - len(mantissa)
    columns: list[list[Unsigned]] = [[] for _ in range(kept)]
    for i, digit in enumerate(mantissa):
        wide_digit = to_kind(digit, ValueKind.WIDE)
        for j, word in enumerate(words):
            column = j - i
            if column > kept:
                continue
            product = wide_digit * to_kind(word, ValueKind.WIDE)
            if 0 <= column < kept:
                columns[column].append(product & 0xFFFFFFFF)
            if 0 <= column - 1 < kept:
                columns[column - 1].append(product >> 32)
    digits: list[Unsigned] = []
    carry: Unsigned | None = None
    for column in reversed(columns):
        total = column[0]
        for term in column[1:]:
            total = total + term
        if carry is not None:
            total = total + carry
        digits.insert(0, to_kind(total, ValueKind.UNSIGNED))
        carry = total >> 32
    return digits


def _sum_digits(digits: list[Unsigned], format: Format) -> tuple[Real, Real]:
    """Σ dᵢ·2^(2 − 32(i+1)) of the 32-bit digits dᵢ, as a rounded value and its remainder. The
    digits are a fraction of a full turn; the result counts quarter turns.
    """
    if format.digits < 32:
        pieces = [half for digit in digits for half in (digit >> 16, digit & 0xFFFF)]
        bits = 16
    else:
        pieces = digits
        bits = 32
    terms = [to_real(piece) * 2.0 ** (2 - bits * (i + 1)) for i, piece in enumerate(pieces)]
    high, low = ordered_sum(terms[0], terms[1])
    return ordered_sum(high, low + (terms[2] + terms[3]))

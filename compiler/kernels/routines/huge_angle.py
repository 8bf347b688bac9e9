"""Reduces huge angles in integer arithmetic, with as many bits of 2/π as the angle needs.

After M. H. Payne and R. N. Hanek, "Radian reduction for trigonometric functions", ACM SIGNUM
Newsletter 18 (1983). x = M·2^E with an integer M; bits of 2/π that contribute multiples of 4 to
x·2/π are omitted from the product.
"""

from __future__ import annotations

from compiler.kernels.routines.double_word import exact_product, ordered_sum
from compiler.kernels.routines.logarithm import normalise
from compiler.kernels.tables.coefficients import HALF_PI, TWO_OVER_PI_WORDS
from compiler.kernels.tables.formats import Format
from compiler.kernels.trace.operations import (
    constant,
    look_up_word,
    select,
    select_word,
    to_kind,
    to_real,
    to_unsigned,
)
from compiler.kernels.trace.statements import Table, ValueKind
from compiler.kernels.trace.values import Real, Unsigned, Value


def reduce_huge(x: Real) -> tuple[Value, ...]:
    """high, low, quadrant of finite x ≥ 2^7 (float) or 2^10 (double), as `reduce_angle`."""
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
    """Number of zero words before 2/π, so that the index is ≥ 0 for the smallest exponent."""
    return 1 if format.digits == 24 else 2


def _integer_mantissa(x: Real) -> tuple[list[Unsigned], Unsigned]:
    """32-bit digits of M, lowest first, and the position of the first relevant bit of 2/π."""
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
    """`count` words of 32 bits of the zeros and 2/π, starting at a bit position."""
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
    """The leading 32-bit digits of the fraction of Σ mᵢ·2^(32 i) × Σ wⱼ·2^(−32(j+1)).

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
    """Σ dᵢ·2^(2 − 32(i+1)), the digits of a fraction of 4 quarter turns, in two words."""
    if format.digits < 32:
        pieces = [half for digit in digits for half in (digit >> 16, digit & 0xFFFF)]
        bits = 16
    else:
        pieces = digits
        bits = 32
    terms = [to_real(piece) * 2.0 ** (2 - bits * (i + 1)) for i, piece in enumerate(pieces)]
    high, low = ordered_sum(terms[0], terms[1])
    return ordered_sum(high, low + (terms[2] + terms[3]))

"""Lists changes of last digits in mathematical functions that change no result, with the reasons.

There are too many pairs of floats to try all; a sentence gives the reason. Functions of one
argument are listed only if they use nothing but the sign of a value far from 0.
"""

from __future__ import annotations

_INFINITE = "it is divided by a zero or NaN, of which it keeps sign and size"
_NEAREST = "the reciprocal of the float nearest to 0 is infinite with the same sign"
_NEVER_0 = "what is compared is no zero: it is a number that is none, or the reciprocal of a zero"
_ZERO_OVER = "0 over the float nearest to 0 is 0, as said there for 0 over 0"
_LARGE = "of smaller sizes another branch is taken; here they are 2⁻¹² at least, or NaN"
_RETURNED = "y is no zero here: 1 was returned for it"
_WHOLE = "the numbers at the limit are even and whole on both sides of it"
_BEYOND = (
    "the logarithm next to 0 times 2³² is beyond the exponents of floats, as with both neighbours"
)
_OVERFLOWS = "from there on results are infinite on both sides of the limit"
_HALVES = (
    "both halves have 12 digits at most either way, so the rest of the product is the same exact "
    "number; where that would be denormal the power is 1"
)
_BELOW_HALF = (
    "the logarithm there is 3·10⁻⁶ at least below that of half the float nearest to 0, its second "
    "word included: 0 either way"
)
_AT_1 = (
    "the float nearest to 0 is left only in a sum of zeros, the logarithm of 1: the power of -1 "
    "stays 1, and that of 1 has returned"
)
_CUT = "the sum is a whole number and at most 2⁻¹⁶ more, which is cut off"

_UP, _DOWN = "0x1.0000000000000p-149f", "-0x1.0000000000000p-149f"
_ABOVE_1, _BELOW_1 = "0x1.0000020000000p+0f", "0x1.fffffe0000000p-1f"
_SIDES = "result = ((side < 0.0f) && ((parity > 0.0f) && (!t27))) ? (-magnitude) : magnitude;"

DIGITS: dict[str, dict[tuple[str, str], str]] = {
    "atan2": {
        (
            "const bool t1 = (height <= 0.0f) && (width <= 0.0f);",
            f"0.0f -> {_UP} (2)",
        ): _ZERO_OVER,
        ("if (fabsf(x) > 0.0f) {", f"0.0f -> {_UP}"): _NEAREST,
        ("side = 1.0f / x;", f"1.0f -> {_ABOVE_1}"): _INFINITE,
        ("side = 1.0f / x;", f"1.0f -> {_BELOW_1}"): _INFINITE,
        ("const float t4 = (side < 0.0f) ? t3 : result;", f"0.0f -> {_UP}"): _NEVER_0,
        ("if (fabsf(y) > 0.0f) {", f"0.0f -> {_UP}"): _NEAREST,
        ("sign = 1.0f / y;", f"1.0f -> {_ABOVE_1}"): _INFINITE,
        ("sign = 1.0f / y;", f"1.0f -> {_BELOW_1}"): _INFINITE,
        ("const float t5 = (sign < 0.0f) ? (-t4) : t4;", f"0.0f -> {_UP}"): _NEVER_0,
    },
    "pow": {
        ("const float t22 = 1.0f / base;", f"1.0f -> {_ABOVE_1}"): _INFINITE,
        ("const float t22 = 1.0f / base;", f"1.0f -> {_BELOW_1}"): _INFINITE,
        ("const float t23 = (y > 0.0f) ? base : y;", f"0.0f -> {_DOWN}"): _RETURNED,
        ("magnitude = (y < 0.0f) ? t22 : t23;", f"0.0f -> {_UP}"): _RETURNED,
        ("if (t24 < 0x1p+24f) {", "0x1p+24f -> 0x1.0000020000000p+24f"): _WHOLE,
        ("if (fabsf(x) > 0.0f) {", f"0.0f -> {_UP}"): _NEAREST,
        ("side = 1.0f / x;", f"1.0f -> {_ABOVE_1}"): _INFINITE,
        ("side = 1.0f / x;", f"1.0f -> {_BELOW_1}"): _INFINITE,
        (_SIDES, f"0.0f -> {_UP} (1)"): _NEVER_0,
        (_SIDES, f"0.0f -> {_UP} (2)"): "what is compared is 0 or 1",
        ("const float t17 = count + 150.0f;", "150.0f -> 0x1.2c00020000000p+7f"): _CUT,
        ("if (t13 >= (-0x1.9fe368p+6f)) {", "0x1.9fe368p+6f -> 0x1.9fe36a0000000p+6f"): _BELOW_HALF,
        **{
            (line, f"0x1.001p+12f -> {factor}"): _HALVES
            for line in (
                "const float t5 = t3 * 0x1.001p+12f;",
                "const float t8 = high * 0x1.001p+12f;",
            )
            for factor in ("0x1.000ffe0000000p+12f", "0x1.0010020000000p+12f")
        },
        **{
            ("magnitude = t13 * 0x1p+127f;", f"0x1p+127f -> {factor}"): _OVERFLOWS
            for factor in ("0x1.0000020000000p+127f", "0x1.fffffe0000000p+126f")
        },
        **{
            ("if (t13 <= 0x1.63643p+6f) {", f"0x1.63643p+6f -> {limit}"): _OVERFLOWS
            for limit in ("0x1.63642e0000000p+6f", "0x1.6364320000000p+6f")
        },
        **{
            (line, f"0x1p+32f -> {limit} ({number})"): _BEYOND
            for line in (
                "const float t2 = (y < (-0x1p+32f)) ? (-0x1p+32f) : y;",
                "const float t3 = (y > 0x1p+32f) ? 0x1p+32f : t2;",
            )
            for limit in ("0x1.0000020000000p+32f", "0x1.fffffe0000000p+31f")
            for number in (1, 2)
        },
    },
    "log_words": {
        (f"const float {of} ? {step}.0f : 0.0f;", f"0.0f -> {beside}"): _AT_1
        for of, step in (
            ("t6 = t1", 85),
            ("t7 = t3", 64),
            ("t11 = t8", 64),
            ("t15 = t12", 32),
            ("t19 = t16", 16),
            ("t23 = t20", 8),
            ("t27 = t24", 4),
            ("t31 = t28", 2),
            ("t35 = t32", 1),
            ("t39 = t37", 1),
        )
        for beside in (_UP, _DOWN)
    },
    **{
        name: {(line, f"0.0f -> {limit}"): _LARGE for line in lines for limit in (_UP, _DOWN)}
        for name, lines in {
            "acos": ("result = (x < 0.0f) ? t12 : t13;",),
            "asin": ("result = (x < 0.0f) ? (-t12) : t12;",),
            "atan": ("result = (x < 0.0f) ? (-t4) : t4;",),
            "sin": ("result = (x < 0.0f) ? (-t9) : t9;",),
            "sinh": ("result = (x < 0.0f) ? (-outer) : outer;",),
            "sigmoid": ("} else if (x < 0.0f) {", "result = (x > 0.0f) ? 1.0f : x;"),
            "softplus": ("} else if (x < 0.0f) {",),
            "tan": (
                "const float t16 = (high < 0.0f) ? (-low) : low;",
                "const float t25 = (high < 0.0f) ? (-t24) : t24;",
                "result = (x < 0.0f) ? (-value) : value;",
            ),
        }.items()
    },
}
"""By function, line and change."""

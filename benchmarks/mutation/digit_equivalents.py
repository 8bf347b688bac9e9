"""Last digits in mathematical functions that change no result, each with the reason.

Pairs of floats are too many to try; of these a sentence says why all are alike. Of functions of one
argument they stand here where only the sign of what is far from 0 is asked.
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
_CUT = "the sum is a whole number and at most 2⁻¹⁶ more, which is cut off"

_UP, _DOWN = "0x1.0000000000000p-149f", "-0x1.0000000000000p-149f"
_ABOVE_1, _BELOW_1 = "0x1.0000020000000p+0f", "0x1.fffffe0000000p-1f"
_SIDES = "result = ((side < 0.0f) && ((parity > 0.0f) && (!t115))) ? (-magnitude) : magnitude;"

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
        ("const float t110 = 1.0f / base;", f"1.0f -> {_ABOVE_1}"): _INFINITE,
        ("const float t110 = 1.0f / base;", f"1.0f -> {_BELOW_1}"): _INFINITE,
        ("const float t111 = (y > 0.0f) ? base : y;", f"0.0f -> {_DOWN}"): _RETURNED,
        ("magnitude = (y < 0.0f) ? t110 : t111;", f"0.0f -> {_UP}"): _RETURNED,
        ("if (t112 < 0x1p+24f) {", "0x1p+24f -> 0x1.0000020000000p+24f"): _WHOLE,
        ("if (fabsf(x) > 0.0f) {", f"0.0f -> {_UP}"): _NEAREST,
        ("side = 1.0f / x;", f"1.0f -> {_ABOVE_1}"): _INFINITE,
        ("side = 1.0f / x;", f"1.0f -> {_BELOW_1}"): _INFINITE,
        (_SIDES, f"0.0f -> {_UP} (1)"): _NEVER_0,
        (_SIDES, f"0.0f -> {_UP} (2)"): "what is compared is 0 or 1",
        ("const float t105 = count + 150.0f;", "150.0f -> 0x1.2c00020000000p+7f"): _CUT,
        **{
            ("magnitude = t101 * 0x1p+127f;", f"0x1p+127f -> {factor}"): _OVERFLOWS
            for factor in ("0x1.0000020000000p+127f", "0x1.fffffe0000000p+126f")
        },
        **{
            ("if (t101 <= 0x1.63643p+6f) {", f"0x1.63643p+6f -> {limit}"): _OVERFLOWS
            for limit in ("0x1.63642e0000000p+6f", "0x1.6364320000000p+6f")
        },
        **{
            (line, f"0x1p+32f -> {limit} ({number})"): _BEYOND
            for line in (
                "const float t90 = (y < (-0x1p+32f)) ? (-0x1p+32f) : y;",
                "const float t91 = (y > 0x1p+32f) ? 0x1p+32f : t90;",
            )
            for limit in ("0x1.0000020000000p+32f", "0x1.fffffe0000000p+31f")
            for number in (1, 2)
        },
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

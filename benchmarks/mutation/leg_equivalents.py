"""Changes of the C of leg.msnn.yaml that change no answer: its geometry stays away from limits.

distance² = forward² + down² of clamped inputs, so distance is in 0.2 … 0.584, the cosine of the
knee in -0.78 … 0.89, and the sine of lean, which is half of the knee, in 0.23 … 0.95. The slopes of
both angles in distance are larger than 1. No parameter has a part in any of them.
"""

from __future__ import annotations

NO_ZERO = "cos of no number in single precision is 0: all were tried"
_STAYS_INSIDE = "valid inputs leave it away from both limits, so that neither limit acts"
_NEVER_0 = "valid inputs leave it away from 0"

_ZERO, _ONE = "0.0f -> 0.001f", "1.0f -> 1.011f"
_CLOSEST, _FARTHEST = "0.05f -> 0.051500000000000004f", "0.599f -> 0.60599f"

LEG: dict[tuple[str, str], str] = {
    ("static const leg_real closest = 0.05f;", _CLOSEST): _STAYS_INSIDE,
    ("static const leg_real farthest = 0.599f;", _FARTHEST): _STAYS_INSIDE,
    ("const leg_real distance = leg_clamp(distance_part_2, 0.05f, 0.599f);", _CLOSEST): (
        _STAYS_INSIDE
    ),
    ("const leg_real distance = leg_clamp(distance_part_2, 0.05f, 0.599f);", _FARTHEST): (
        _STAYS_INSIDE
    ),
    ("const bool distance_part_3 = 0.05f <= distance_part_2;", _CLOSEST): _STAYS_INSIDE,
    ("const bool distance_part_4 = distance_part_2 <= 0.599f;", _FARTHEST): _STAYS_INSIDE,
    ("return (a <= b) ? a : ((a > b) ? b : (a + b));", "> -> <="): _STAYS_INSIDE,
    ("return (a >= b) ? a : ((a < b) ? b : (a + b));", "< -> >="): _STAYS_INSIDE,
    ("const leg_real lean_part_4 = ((lean_part <= 1.0f)", _ONE): _STAYS_INSIDE,
    (": 0.0f;", _ZERO): _STAYS_INSIDE,
    ("const leg_real lean_part_6 = (fabsf(lean_part_5) <= 0.0f) ? 0.0f", f"{_ZERO} (2)"): NO_ZERO,
    ("const leg_real knee_part_3 = (fabsf(lean_part_6) <= 0.0f) ? 0.0f", f"{_ZERO} (2)"): NO_ZERO,
    ("const bool distance_part_8 = fabsf(distance_part_7) <= 0.0f;", _ZERO): _NEVER_0,
    (": (distance_part_8 ? 0.0f : (distance_part_6 * distance_part_7));", _ZERO): _NEVER_0,
    (": (distance_part_8 ? 0.0f : (distance_part_15 * distance_part_7));", _ZERO): _NEVER_0,
    ("const bool distance_part_10 = fabsf(down) <= 0.0f;", _ZERO): _NEVER_0,
    (
        "const leg_real distance_part_11 = distance_part_10 ? 0.0f : (distance_part_9 * down);",
        _ZERO,
    ): _NEVER_0,
    (
        "const leg_real distance_part_17 = distance_part_10 ? 0.0f : (distance_part_16 * down);",
        _ZERO,
    ): _NEVER_0,
    (
        (
            "const leg_real distance_part_6 = distance_part_4 ? (distance_part_3 ? "
            "distance_part_5 : "
            "0.0f)"
        ),
        _ZERO,
    ): _STAYS_INSIDE,
    (
        (
            "const leg_real distance_part_15 = distance_part_4 ? (distance_part_3 "
            "? distance_part_14 : "
            "0.0f)"
        ),
        _ZERO,
    ): _STAYS_INSIDE,
}
for _number in (1, 2):
    LEG |= {
        (
            (
                "const leg_real lean = leg_asin(leg_clamp((shin * leg_sin(knee)) / "
                "distance, -1.0f, "
                "1.0f));"
            ),
            f"{_ONE} ({_number})",
        ): _STAYS_INSIDE,
        (
            "const leg_real lean_part_2 = leg_clamp(lean_part, -1.0f, 1.0f);",
            f"{_ONE} ({_number})",
        ): _STAYS_INSIDE,
        (
            "? (((-1.0f) <= lean_part) ? lean_part_3 : 0.0f) : 0.0f) / distance;",
            f"{_ZERO} ({_number})",
        ): _STAYS_INSIDE,
        (
            ": ((fabsf(knee_part_2) <= 0.0f) ? 0.0f : (lean_part_6 * knee_part_2));",
            f"{_ZERO} ({_number})",
        ): _NEVER_0,
        (
            (
                "const leg_real knee_part_5 = (-((fabsf(lean_part) <= 0.0f) ? 0.0f : "
                "(lean_part_4 * "
                "lean_part)))"
            ),
            f"{_ZERO} ({_number})",
        ): _NEVER_0,
        (
            "const leg_real distance_part_9 = (fabsf(distance_part_6) <= 0.0f) ? 0.0f",
            f"{_ZERO} ({_number})",
        ): _NEVER_0,
        (
            "const leg_real distance_part_16 = (fabsf(distance_part_15) <= 0.0f) ? 0.0f",
            f"{_ZERO} ({_number})",
        ): _NEVER_0,
    }
LEG["? (((-1.0f) <= lean_part) ? lean_part_3 : 0.0f) : 0.0f) / distance;", _ONE] = _STAYS_INSIDE

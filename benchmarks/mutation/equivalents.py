"""Lists changes of generated C that change no result, each with the reason."""

from __future__ import annotations

import re

from benchmarks.mutation.digit_equivalents import DIGITS
from benchmarks.mutation.leg_equivalents import LEG, NO_ZERO
from benchmarks.mutation.mutants import Mutant
from tests.verification.unreached import UNREACHED

_FILLED = "the first step fills the samples anew"
_TIMES_ZERO = "what is changed is multiplied by 0"
_LOWER = "the valid number nearest to 0, which is there already, is the lower limit of every input"
_AGAIN = "the entry is written again below"
_SAME = "the entry is that number already"
_TOGETHER = "it is infinite or NaN together with another element, which sets the same bit"
_OUTSIDE = "what is flagged is outside already: it is below any number that is not below 0"
_TWICE = "another entry has the same value, and the test of that one sets the same bit"
_PUT_RIGHT = "a wrong interval is put right by the comparisons that follow"
_CLIPPED = "the number was clipped to its range: only NaN is outside"
_NOT_TAKEN = "the choice beside it takes what is changed nowhere where it differs"
_FLAT_SIDE = (
    "what the outermost set has on its flat side is multiplied by 0, and a parameter is finite"
)
_ABOVE_0 = "only whether it is above 0 is asked"
_ZEROS = "only the sign of a zero differs"
_0_OR_MORE = "the number is 0 or far above 0.001"
_TOLD_AGAIN = "the last entry is tested in another matrix, too, which sets the same bit"
_IN_ROOM = "sign is multiplied by 0 unless its argument is beyond the room of 0.08"

_SETS_PLACE = "const reference_real sets_place = (s->v + 45.0f) * 0.06666667f;"
_BELOW = "sets_here = ((s->v + 45.0f) * 0.0f) + 1.0f;"
_ABOVE = "sets_next = ((s->v - 45.0f) * 0.0f) + 1.0f;"

_FLAGGED = re.compile(r"_(?:flagged|held)\([^,]*, 0\.0f, ")
_CHECK = re.compile(r"if \(!\(fabsf\(s->\w+(?:\[[^\]]*\])?\) <= 3\.4028235e\+38f\)\) \{")
_CHECKED = re.compile(
    r"for \(uint32_t \w = 0U; \w < (\d+)U; \w\+\+\) \{\s+"
    r"(?:for \(uint32_t \w = 0U; \w < (\d+)U; \w\+\+\) \{\s+)?(if \(!\(fabsf\(s->[^\n]*)"
)
"""A loop over a state that does nothing but check it."""
_NO_ADDEND = re.compile(r"^const \w+_real (\w+) = [^=;]* \+ 0\.0f;$")
_TEST = re.compile(r"^if \(!\(fabsf\((jac->\w+\[[^\]]*\])\) <= 3\.4028235e\+38f\)\) \{")
_STORE = re.compile(r"^ +(jac->\w+\[[^\]]*\]) = ([^;]*);", re.MULTILINE)
_CONSTANT = re.compile(r"^ +const \w+_real (\w+) = ", re.MULTILINE)

_CLAMPED_LOW = {("result = low;", "result = low; -> ;"): _LOWER}


def _stores(places: str, why: str) -> dict[tuple[str, str], str]:
    """Entries of the list for deleted stores to the Jacobian, one per line."""
    return {(line, f"{line} -> ;"): why for line in places.strip().splitlines()}


_SIGN = "return (x > 0.0f) ? 1.0f : ((x < 0.0f) ? (-1.0f) : ((x >= 0.0f) ? 0.0f : x));"
_ZERO, _ONE = "0.0f -> 0.001f", "1.0f -> 1.011f"

_LENGTH = (
    "it is 0 only where the length is infinite: then a turn is infinite by infinite, and what is "
    "added NaN"
)

EQUIVALENTS: dict[str, dict[tuple[str, str], str]] = {
    "cart_pole": {
        (
            "const cart_pole_real pull_part_59 = ((fabsf(turn_part_12) <= 0.0f) ? 0.0f",
            "0.0f -> 0.001f (2)",
        ): _LENGTH,
        (
            "const cart_pole_real pull_part_78 = ((fabsf(turn_part_19) <= 0.0f) ? 0.0f",
            "0.0f -> 0.001f (2)",
        ): _LENGTH,
        (
            "jac->C[14U] = pull_part_101 + ((fabsf(pull_part_3) <= 0.0f) ? 0.0f",
            "0.0f -> 0.001f (2)",
        ): NO_ZERO,
        (
            "if (!(fabsf(jac->C[14U]) <= 3.4028235e+38f)) {",
            "3.4028235e+38f -> 3.4368517349999996e+38f",
        ): _TOGETHER,
    },
    "arm_friction": _stores(
        """
jac->A[i + 60U] = part_36[i];
jac->A[64U] = part_33;
jac->A[i + 140U] = part_48[i];
jac->A[144U] = part_45;
jac->A[i + 220U] = part_60[i];
jac->A[224U] = part_57;
jac->C[i] = part_36[i];
jac->C[4U] = part_33;
jac->C[i + 20U] = part_48[i];
jac->C[24U] = part_45;
jac->C[i + 40U] = part_60[i];
jac->C[44U] = part_57;
""",
        _AGAIN,
    )
    | _stores(
        """
jac->A[60U] = part;
jac->A[140U] = part_6;
jac->A[220U] = part_11;
jac->C[0U] = part;
jac->C[20U] = part_6;
jac->C[40U] = part_11;
""",
        _SAME,
    )
    | {
        (
            f"if (!(fabsf(s->rate_tape[{newest}U]) <= 3.4028235e+38f)) {{",
            "3.4028235e+38f -> 3.4368517349999996e+38f",
        ): _CLIPPED
        for newest in (4, 9, 14)
    },
    "battery": _CLAMPED_LOW
    | {
        (_SIGN, f"{_ZERO} (3)"): _ZEROS,
        ("if (s->charge >= 0.3f) {", "0.3f -> 0.304f"): _PUT_RIGHT,
        ("if (!((s->charge >= 0.0f) && (s->charge <= 1.0f))) {", "&& -> ||"): _CLIPPED,
        ("if (!((s->charge >= 0.0f) && (s->charge <= 1.0f))) {", _ONE): _CLIPPED,
        ("0.1f, 0.3f, 0.6f, 0.9f, 1.0f, 1.0f", f"{_ONE} (2)"): _TIMES_ZERO,
        ("0.0f, 0.0f, 0.1f, 0.3f, 0.6f, 0.9f", f"{_ZERO} (1)"): _TIMES_ZERO,
        ("0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 1.0f", _ONE): _ABOVE_0,
        ("1.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f", _ONE): _ABOVE_0,
        (
            ">= (((s->charge - constants_2[i]) * constants_3[i]) + constants_4[i])) ? 0.0f",
            "+ -> -",
        ): _FLAT_SIDE,
        (
            (
                "+ constants_7[i]) >= 0.0f) ? (voltage_now_part[i] ? "
                "p->open_circuit_y[i] : 0.0f) : "
                "0.0f;"
            ),
            "+ -> -",
        ): _FLAT_SIDE,
    },
    "engine_map": _CLAMPED_LOW
    | {
        (f"const engine_map_real {of} = (((0.0f >= {side}[3U]) ? 0.0f", ">= -> <"): _FLAT_SIDE
        for of, side in (
            ("torque_now_part_23", "torque_now_part_3"),
            ("torque_now_part_29", "torque_now_part_11"),
        )
    },
    "heater": _CLAMPED_LOW
    | {
        ("if (!(fabsf(s->error_sum) <= 500.0f)) {", "500.0f -> 505.001f"): _CLIPPED,
        (
            (
                ": (heater_exp(heater_minimum(ageing_part, 0.0f)) - 1.0f)) + heater_cosh(s->oven / "
                "400.0f);"
            ),
            _ZERO,
        ): _NOT_TAKEN,
        (
            "* heater_exp(ageing_part_2 ? 0.5f : heater_minimum(ageing_part, 0.0f)));",
            _ZERO,
        ): _NOT_TAKEN,
        (
            "+ ((ageing_part <= 0.0f) ? part : 0.0f)) * p->wear_weight[0U]) / 200.0f;",
            f"{_ZERO} (1)",
        ): "part is 0 where the argument is above 0",
        (
            "? ((heater_maximum(asked_part_2, 0.0f) <= 1.0f) ? 1.0f : 0.0f) : 0.0f;",
            f"{_ZERO} (1)",
        ): "only whether it is above 1 is asked",
    },
    "leg": LEG,
    "tyre": {
        (
            (
                ": (((fabsf(force_now_part_2) <= 0.0f) ? 0.0f : (peak * "
                "force_now_part_2)) * p->shape);"
            ),
            f"{_ZERO} (2)",
        ): NO_ZERO,
    },
    "quarter_car": {(_SIGN, f"{_ZERO} ({number})"): _IN_ROOM for number in range(1, 5)},
    "lane_keeper": _stores(
        """
jac->A[41U] = anticipated_part_6[0U];
jac->A[42U] = anticipated_part_6[1U];
jac->B[40U] = part_15;
jac->D[0U] = part_15;
""",
        _SAME,
    )
    | _stores(
        """
jac->B[40U] = anticipated_part_5[2U];
jac->D[0U] = anticipated_part_5[2U];
""",
        _AGAIN,
    )
    | {
        (
            "if (!(fabsf(s->steering_tape[4U]) <= 3.4028235e+38f)) {",
            "3.4028235e+38f -> 3.4368517349999996e+38f",
        ): _CLIPPED,
        ("const lane_keeper_real calm_part_3 = lane_keeper_maximum(0.0f, calm_part);", _ZERO): (
            "only whether it is above 1 is asked"
        ),
        (
            (
                "const lane_keeper_real steering_next_part_8 = "
                "(fabsf(steering_next_part_3) <= 0.0f) ? "
                "0.0f"
            ),
            f"{_ZERO} (1)",
        ): _0_OR_MORE,
        ("const bool correction_part_4 = fabsf(steering_next_part_7) <= 0.0f;", _ZERO): _0_OR_MORE,
        (
            "const lane_keeper_real calm_part_12 = (((0.0f >= calm_part) ? 0.0f",
            f"{_ZERO} (1)",
        ): _NOT_TAKEN,
        ("for (uint32_t i = 0U; i < 5U; i++) {", "5 -> 4"): _TOLD_AGAIN,
        ("for (uint32_t i = 0U; i < 8U; i++) {", "8 -> 7"): _TOLD_AGAIN,
    },
    "two_tanks": _CLAMPED_LOW,
    "reference": {
        ("for (uint32_t i = 0U; i < 24U; i++) {", "24 -> 23"): _FILLED,
        ("s->u_history[i] = 0.0f;", "0.0f -> 0.001f"): _FILLED,
        ("for (uint32_t i = 0U; i < 24U; i += 4U) {", "24 -> 23"): "20 is the last i of both",
        ("for (uint32_t i = 0U; i < 25U; i++) {", "25 -> 24"): _AGAIN,
        ("-45.0f, -45.0f, -30.0f, -15.0f, 0.0f, 15.0f, 30.0f", "45.0f -> 45.451f (1)"): _TIMES_ZERO,
        ("-30.0f, -15.0f, 0.0f, 15.0f, 30.0f, 45.0f, 45.0f", "45.0f -> 45.451f (2)"): _TIMES_ZERO,
        (_ABOVE, "- -> +"): _TIMES_ZERO,
        (_ABOVE, "45.0f -> 45.451f"): _TIMES_ZERO,
        (_BELOW, "+ -> - (1)"): _TIMES_ZERO,
        (_BELOW, "45.0f -> 45.451f"): _TIMES_ZERO,
        (_SETS_PLACE, "45.0f -> 45.451f"): _PUT_RIGHT,
        (_SETS_PLACE, "0.06666667f -> 0.0683333367f"): _PUT_RIGHT,
        ("const reference_real v_next_part_2 = (v_next_part + 0.0f)", "+ -> -"): (
            "only the sign of a zero differs, and the next sum adds a number to it"
        ),
    },
}
"""By model: the line and the change. Equal lines share an entry: `_FILLED` is of that in init."""


_COUPLED = {
    "cart_pole_linearize": ("if (!(fabsf(jac->C[14U]) <= 3.4028235e+38f)) {",),
    "battery_step": ("if (!(fabsf(s->polarisation_state[1U]) <= 3.4028235e+38f)) {",),
    "heater_step": tuple(
        f"if (!(fabsf(s->element_state[{i}U]) <= 3.4028235e+38f)) {{" for i in range(3)
    ),
}
"""Checks of elements of a filter's memory: the second sample of a filter was the first before, and
keeps it infinite; each element of a state space depends on all. The slope of the angle shown is
at most 1 of a finite angle, and of another all slopes in the angle are NaN."""


def reason(prefix: str, mutant: Mutant) -> str | None:
    """The reason why a change changes no result; None if none is known."""
    if mutant.kind == "last digit":
        return DIGITS.get(mutant.function.removeprefix(f"{prefix}_"), {}).get(
            (mutant.line, mutant.change)
        )
    if mutant.line == "s->reserved = 0U;":
        return "nothing reads the field that an empty struct has"
    if _FLAGGED.search(mutant.line) and mutant.change == "0.0f -> 0.001f":
        return _OUTSIDE
    if _is_told_twice(mutant):
        return _TWICE
    if _loses_only_a_sign(mutant):
        return _ZEROS
    if (never := _unreached_check(prefix, mutant)) is not None:
        return never
    condition, bit, rest = mutant.line.partition(" status |= ")
    # a check of which nothing is left may be missing altogether
    beyond = mutant.kind == "value" and _CHECK.fullmatch(condition) is not None
    if (mutant.kind == "deleted" or beyond) and condition in _COUPLED.get(mutant.function, ()):
        return _TOGETHER
    if beyond and mutant.change.startswith("3.4028235e+38f -> "):
        never = UNREACHED.get(prefix, {})
        place = f"{mutant.function}: 1 branch not reached: {condition}"
        return never.get(place) or EQUIVALENTS.get(prefix, {}).get((mutant.line, mutant.change))
    if mutant.kind == "deleted" and bit:
        unreached, where = UNREACHED.get(prefix, {}), mutant.function
        if f"{where}: line not reached: status |= {rest}" in unreached:
            return unreached.get(f"{where}: 1 branch not reached: {condition}")
        return None
    return EQUIVALENTS.get(prefix, {}).get((mutant.line, mutant.change))


def _loses_only_a_sign(mutant: Mutant) -> bool:
    """True if 0 is subtracted instead of added and the result is only an entry of the Jacobian.

    Golden Jacobians do not distinguish zeros by sign: `linearize` omits terms that are 0.
    """
    sum = _NO_ADDEND.match(mutant.line)
    if sum is None or mutant.change != "+ -> -":
        return False
    read = re.findall(rf"^.*\b{sum[1]}\b.*$", _function_text(mutant), re.MULTILINE)
    stored = re.compile(rf"^ +jac->\w+\[\d+U\] = {sum[1]};$")
    return len(read) > 1 and all(stored.match(line) for line in read[1:])


def _unreached_check(prefix: str, mutant: Mutant) -> str | None:
    """The reason why a loop of checks may end early: what it checks is always valid."""
    count = mutant.change.partition(" -> ")[2]
    for *bounds, condition in _CHECKED.findall(_function_text(mutant)):
        place = f"{mutant.function}: 1 branch not reached: {condition}"
        if mutant.line.startswith("for (") and count in bounds:
            return UNREACHED.get(prefix, {}).get(place)
    return None


def _function_text(mutant: Mutant) -> str:
    """The text of the changed function, from its header to its last brace."""
    begin = re.search(rf"^[^\n;]*\b{mutant.function}\([^;{{]*\)\n\{{", mutant.text, re.MULTILINE)
    if begin is None:
        return ""
    return mutant.text[begin.start() : mutant.text.index("\n}", begin.end())]


def _is_told_twice(mutant: Mutant) -> bool:
    """True if the same value is also tested by an unchanged statement.

    `y: next(x)` has the derivatives of x: a value stored in one matrix is stored in another one
    too, and is tested twice.
    """
    test = _TEST.search(mutant.line)
    broken = mutant.change.startswith("3.4028235e+38f ->") or mutant.kind == "deleted"
    if test is None or not broken:
        return False
    stores: dict[str, list[str]] = {}
    for store in _STORE.finditer(mutant.text):
        stores.setdefault(store[1], []).append(store[2])
    own = stores.get(test[1], [])
    whole = re.sub(r"\n +status \|= ", " status |= ", mutant.text)
    same = [place for place, values in stores.items() if values == own]
    tests = sum(whole.count(f"(fabsf({p}) <= 3.4028235e+38f)) {{ status |= ") for p in same)
    return tests > 0 and all(_is_kept(value, mutant.text) for value in own)


def _is_kept(value: str, text: str) -> bool:
    """True if a value is a constant, or an element of an array that does not change any more."""
    name, element, _ = value.partition("[")
    if not element:
        return name in _CONSTANT.findall(text)
    written = [match.start() for match in re.finditer(rf"\b{name}\[[^\]]*\] = ", text)]
    first = text.index(f" = {value};", text.index("jac->"))
    return bool(written) and max(written) < first

"""Changes of generated C that change no answer, each with the reason."""

from __future__ import annotations

from benchmarks.mutation.mutants import Mutant

_FILLED = "the first step fills the samples anew"
_TIMES_ZERO = "what is changed is multiplied by 0"
_PUT_RIGHT = "an interval that is one too high is put right by the comparison that follows"

_SETS_PLACE = "const reference_real sets_place = (s->v + 45.0f) * 0.06666667f;"
_BELOW = "sets_here = ((s->v + 45.0f) * 0.0f) + 1.0f;"
_ABOVE = "sets_next = ((s->v - 45.0f) * 0.0f) + 1.0f;"

EQUIVALENTS: dict[str, dict[tuple[str, str], str]] = {
    "reference": {
        ("for (uint32_t i = 0U; i < 24U; i++) {", "24 -> 23"): _FILLED,
        ("s->u_history[i] = 0.0f;", "0.0f -> 0.001f"): _FILLED,
        ("for (uint32_t i = 0U; i < 24U; i += 4U) {", "24 -> 23"): "20 is the last i of both",
        (_ABOVE, "- -> +"): _TIMES_ZERO,
        (_ABOVE, "45.0f -> 45.451f"): _TIMES_ZERO,
        (_BELOW, "+ -> -"): _TIMES_ZERO,
        (_BELOW, "45.0f -> 45.451f"): _TIMES_ZERO,
        (_SETS_PLACE, "45.0f -> 45.451f"): _PUT_RIGHT,
        (_SETS_PLACE, "0.06666667f -> 0.0683333367f"): _PUT_RIGHT,
        ("const reference_real v_next_part_2 = (v_next_part + 0.0f)", "+ -> -"): (
            "only the sign of a zero differs, and the next sum adds a number to it"
        ),
    }
}
"""By model: the line and the change. Equal lines share an entry: `_FILLED` is of that in init."""


def reason(prefix: str, mutant: Mutant) -> str | None:
    """Why a change changes no answer; None where it is not known to be so."""
    return EQUIVALENTS.get(prefix, {}).get((mutant.line, mutant.change))

"""Lists changes of a training kernel's C that change no result, each with the reason."""

from __future__ import annotations

import re

from benchmarks.mutation.mutants import Mutant

_CHOSEN_AWAY = "the slope of the choice between a number and a missing target chooses it away"
_FLAT = "the outermost sets are flat: what is changed is multiplied by 0"
_LARGER = "the other operand of the maximum is 1"
_SIGN = "a factor above 0 changes no sign, and a comparison with 0 asks for nothing else"
_UNUSED = "the slope at the flat side of an outermost set, which is multiplied by 0"

_ZERO, _ONE, _EDGE = "0.0f -> 0.1f", "1.0f -> 1.11f", "1.5f -> 1.6150000000000002f"
_FIRST = (
    "msnn_maximum(fused(tape_v_tape[0U] - splat(-1.0f), splat(0.0f), splat(1.0f)), splat(0.0f)),"
)
_LAST = "fused(tape_v_tape[0U] - splat(1.0f), splat(0.0f), splat(1.0f))));"
_FIRST_SIDE = (
    "const lanes part_12 = choose(fused(tape_v_tape[0U] - splat(-1.0f), splat(0.0f), splat(1.0f))"
)
_FIRST_CHOICE = ">= splat(0.0f), choose(part[0U], part_9[0U], splat(0.0f)), splat(0.0f));"
_LAST_SIDE = ">= fused(tape_v_tape[0U] - splat(1.0f), splat(0.0f), splat(1.0f)), splat(0.0f),"

_EDGES = (
    ">= fused(tape_v_tape[0U] - splat(-0.33333334f), splat(-1.5f), splat(0.0f)), splat(0.0f),",
    ">= fused(tape_v_tape[0U] - splat(0.33333334f), splat(-1.5f), splat(0.0f)), splat(0.0f),",
    ">= fused(tape_v_tape[0U] - splat(1.0f), splat(-1.5f), splat(0.0f)), splat(0.0f),",
    "const lanes part_14 = choose(fused(tape_v_tape[0U] - splat(-1.0f), splat(1.5f), splat(0.0f))",
    "const lanes part_16 = choose(fused(tape_v_tape[0U] - splat(-0.33333334f), splat(1.5f),",
    "const lanes part_18 = choose(fused(tape_v_tape[0U] - splat(0.33333334f), splat(1.5f),",
)

KERNEL_EQUIVALENTS: dict[str, dict[tuple[str, str], str]] = {
    "memory": {
        ("const lanes part_3 = scale[0U] * choose(part, part_2, splat(0.0f));", _ZERO): _CHOSEN_AWAY
    },
    "filtered_joints": {
        (f"part_2[{i}U] = scale[0U] * choose(part[{i}U], part_{i + 3}, splat(0.0f));", _ZERO): (
            _CHOSEN_AWAY
        )
        for i in range(3)
    },
    "vehicle": {
        ("const lanes part_4 = scale[0U] * choose(part_2, part_3, splat(0.0f));", _ZERO): (
            _CHOSEN_AWAY
        ),
        (_FIRST, "- -> +"): _FLAT,
        (_FIRST, _ONE): _FLAT,
        (_FIRST, _ZERO): _LARGER,
        ("splat(0.0f)), msnn_maximum(splat(0.0f),", _ZERO): _LARGER,
        (_LAST, "- -> +"): _FLAT,
        (_LAST, _ONE): _FLAT,
        (_FIRST_SIDE, "- -> +"): _UNUSED,
        (_FIRST_SIDE, _ONE): _UNUSED,
        (_FIRST_SIDE, _ZERO): _UNUSED,
        (_FIRST_CHOICE, ">= -> <"): _UNUSED,
        (_FIRST_CHOICE, _ZERO): _UNUSED,
        ("const lanes part_17 = choose(splat(0.0f)", _ZERO): _UNUSED,
        (_LAST_SIDE, ">= -> <"): _UNUSED,
        (_LAST_SIDE, "- -> +"): _UNUSED,
        (_LAST_SIDE, _ONE): _UNUSED,
        (_LAST_SIDE, _ZERO): _UNUSED,
        ("choose(part[3U], splat(0.0f), part_9[3U]));", _ZERO): _UNUSED,
        **{(line, _EDGE): _SIGN for line in _EDGES},
    },
}
"""By model: the line and the change. Equal lines share an entry, and so do equal changes of a line;
it counts where none is found."""


def kernel_reason(name: str, mutant: Mutant) -> str | None:
    """The reason why a change changes no result; None if none is known."""
    change = re.sub(r" \(\d+\)$", "", mutant.change)
    return KERNEL_EQUIVALENTS.get(name, {}).get((mutant.line, change))

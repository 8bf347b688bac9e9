"""C functions that choose without a branch: what a compiler could turn into one is not written.

Where both values of `c ? a : b` are computed, compilers may still move the work into the arms. An
element of an array at a place that depends on c is read in the same instructions for every c. They
may also write the code behind a comparison twice, once for each result. So a truth value is an
integer here, 0 or 1, and has been in a volatile object, about which nothing is known.
"""

from __future__ import annotations

from collections.abc import Iterable

from compiler.kernels.tables.formats import Format
from compiler.kernels.trace.statements import Kind, Operator

SELECT = {
    Kind.REAL: "select_real",
    Kind.UNSIGNED: "select_word",
    Kind.WIDE: "select_wide",
    Kind.TRUTH: "select_word",
}
"""What stands for `condition ? then : otherwise`, by the kind of its value."""

COMBINE = {Operator.BOTH: "&", Operator.EITHER: "|"}
"""What stands for `&&` and `||`, which leave out their second operand."""

TRUTH = "truth_word"
"""What stands around a comparison."""


def choice_functions(names: Iterable[str], format: Format, prefix: str) -> list[str]:
    """Definitions of the functions named, in a fixed order."""
    wanted = set(names)
    types = {"real": format.c_type, "word": "uint32_t", "wide": "uint64_t"}
    truth = [_TRUTH.format(prefix=prefix)] if TRUTH in wanted else []
    return truth + [
        _SELECT.format(prefix=prefix, kind=kind, type=type)
        for kind, type in types.items()
        if f"select_{kind}" in wanted
    ]


_TRUTH = """\
static inline uint32_t {prefix}_truth_word(bool condition)
{{
    const uint32_t yes = 1U;
    const uint32_t no = 0U;
    const volatile uint32_t known = condition ? yes : no;
    return known;
}}
"""

_SELECT = """\
static inline {type} {prefix}_select_{kind}(uint32_t truth, {type} then, {type} otherwise)
{{
    const {type} both[2] = {{otherwise, then}};
    return both[truth];
}}
"""

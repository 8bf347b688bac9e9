"""Proves that a change of generated C changes no answer while clamped inputs are in their ranges.

Both functions are evaluated symbolically, first without any rule: what is stored and written again
changes nothing. What can be one number only, by bounds, is that number,
so that what is multiplied by 0 or chosen nowhere is gone; the answers must be the same expressions.
Where they are not, the ranges are divided at the numbers that inputs are compared with. Rounding to
the nearest is monotone: the results at the ends of intervals bound those between. Zeros have no
sign here.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from benchmarks.mutation.symbolic_c import Interval, NotProvedError, answers_of

_CLAMPED = re.compile(
    r"^    (\w+)_real (\w+) = u->\2;\n"
    r"    if \(!\(\(u->\2 >= (?P<low>\S+)f\) && \(u->\2 <= (?P<high>\S+)f\)\)\) \{\n"
    r"        \2 = \1_clamped\(u->\2, (?P=low)f, (?P=high)f, \S+f, &status\);\n"
    r"    \}\n",
    re.MULTILINE,
)
_BODY = r"^[^\n#/{{}} ][^\n#/{{}}(]*?{name}\([^;{{}}]*\)\n\{{\n(.*?)^\}}"
_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)


def alike_inside_ranges(source: str, changed: str, function: str) -> bool:
    """True if it is proved that a function has the same results after a change."""
    try:
        first, second = answers_of(
            [_body(text, function) for text in (source, changed)], {}, exact=True
        )
        if first == second:
            return True
    except NotProvedError:
        pass
    try:
        (right, ranges, cuts), (wrong, others, _) = (_read(t, function) for t in (source, changed))
        return ranges == others and _alike(right, wrong, ranges, cuts)
    except NotProvedError:
        return False


def _read(text: str, function: str) -> tuple[str, dict[str, Interval], dict[str, list[np.float32]]]:
    """The computation of a function after its inputs are clamped, their ranges, and thresholds in
    them.
    """
    body = _body(text, function)
    ranges = {
        m[2]: (np.float32(m["low"].strip("()")), np.float32(m["high"].strip("()")))
        for m in _CLAMPED.finditer(body)
    }
    rest = _CLAMPED.sub("", body)
    if not ranges or "u->" in rest:
        raise NotProvedError
    compared = re.compile(rf"\b({'|'.join(ranges)}) (?:<|>|<=|>=) (\d\S*)f")
    cuts = {name: sorted({*ends}) for name, ends in ranges.items()}
    for name, number in compared.findall(rest):
        low, high = ranges[name]
        if low < np.float32(number) < high:
            cuts[name] = sorted({*cuts[name], np.float32(number)})
    return rest, ranges, cuts


def _body(text: str, function: str) -> str:
    found = re.search(_BODY.format(name=function), _COMMENT.sub("", text), re.DOTALL | re.MULTILINE)
    if found is None:
        raise NotProvedError
    return found[1]


def _alike(
    right: str, wrong: str, case: Mapping[str, Interval], cuts: Mapping[str, list[np.float32]]
) -> bool:
    """True if the results are the same expressions, in the whole case or in all parts of it."""
    first, second = answers_of((right, wrong), case)
    if first == second:
        return True
    for name, (low, high) in case.items():
        inside = [cut for cut in cuts[name] if low <= cut <= high]
        if low < high and inside:
            cut = inside[len(inside) // 2]
            parts = [
                (low, np.nextafter(cut, np.float32(-np.inf))),
                (cut, cut),
                (np.nextafter(cut, np.float32(np.inf)), high),
            ]
            return all(
                _alike(right, wrong, {**case, name: part}, cuts)
                for part in parts
                if part[0] <= part[1]
            )
    return False

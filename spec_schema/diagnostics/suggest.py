"""Finds what a mistyped word or number was meant to be, for "did you mean"."""

import re
from collections.abc import Iterable

_LONGEST = 60


def nearest(word: str, known: Iterable[str]) -> str | None:
    """The known word within a third of its length in typing errors, or None.

    Of words that are equally near it is one of the same length, else the first. Typing errors are
    inserted, lost, changed and swapped characters (Damerau 1964).
    """
    if len(word) > _LONGEST:
        return None
    furthest = max(1, len(word) // 3)
    best, nearness = None, (furthest + 1, False)
    for candidate in known:
        longer = len(candidate) - len(word)
        # each character more or less is a typing error: the distance need not be computed
        if abs(longer) > min(furthest, nearness[0]):
            continue
        distance = _distance(word.casefold(), candidate.casefold())
        # a word of which every letter is wrong is another word
        if (distance, longer != 0) < nearness and distance < len(word):
            best, nearness = candidate, (distance, longer != 0)
    return best


def did_you_mean(meant: str | None) -> str | None:
    """The help line "did you mean …?"; None if there is no suggestion."""
    return f"did you mean `{meant}`?" if meant else None


def _distance(left: str, right: str) -> int:
    before: list[int] = []
    current = list(range(len(right) + 1))
    for row, a in enumerate(left, start=1):
        before, previous, current = current, before, [row]
        for column, b in enumerate(right, start=1):
            cost = min(before[column] + 1, current[-1] + 1, before[column - 1] + (a != b))
            # `previous` is the row before the last: a swap reaches two characters back in both
            # words
            swapped = row > 1 and column > 1 and a == right[column - 2] and b == left[row - 2]
            current.append(min(cost, previous[column - 2] + 1) if swapped else cost)
    return current[-1]


_DECIMAL_COMMA = re.compile(r"([+-]?\d+),(\d+)((?:[^\d,][^,]*)?)")


def with_point_or_joined(text: str) -> tuple[str, ...]:
    """Lists possible meanings: `2.5` for `2,5`; for `1,200` first 1200, then `1.200`."""
    point, joined = text.replace(",", "."), text.replace(",", "")
    return (point,) if with_decimal_point(text) else (joined, point)


def with_decimal_point(text: str) -> str | None:
    """`0.05 s` for `0,05 s`; None without a comma, or if it may separate thousands."""
    found = _DECIMAL_COMMA.fullmatch(text.strip())
    # `1,500` is fifteen hundred to some and one and a half to others
    if found is None or (len(found[2]) == 3 and found[1].lstrip("+-") != "0"):
        return None
    return f"{found[1]}.{found[2]}{found[3]}"

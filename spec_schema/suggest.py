"""Did you mean: the known word nearest to a mistyped one."""

from collections.abc import Iterable

_LONGEST = 60


def nearest(word: str, known: Iterable[str]) -> str | None:
    """The known word within a third of its length in typing errors; the first of equals, or None.

    Typing errors are inserted, lost, changed and swapped characters (Damerau 1964).
    """
    if len(word) > _LONGEST:
        return None
    best, best_distance = None, max(1, len(word) // 3) + 1
    for candidate in known:
        if abs(len(candidate) - len(word)) >= best_distance:
            continue
        distance = _distance(word.casefold(), candidate.casefold())
        if distance < best_distance and distance < len(word):
            best, best_distance = candidate, distance
    return best


def _distance(left: str, right: str) -> int:
    before: list[int] = []
    current = list(range(len(right) + 1))
    for row, a in enumerate(left, start=1):
        before, previous, current = current, before, [row]
        for column, b in enumerate(right, start=1):
            cost = min(before[column] + 1, current[-1] + 1, before[column - 1] + (a != b))
            swapped = row > 1 and column > 1 and a == right[column - 2] and b == left[row - 2]
            current.append(min(cost, previous[column - 2] + 1) if swapped else cost)
    return current[-1]

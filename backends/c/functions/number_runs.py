"""Groups equal values at equidistant indices, which a loop can write."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class NumberRun:
    """The same value at first, first + stride, …; a single value has the stride 1."""

    value: float
    first: int
    stride: int
    count: int


def number_runs(numbers: Mapping[int, float]) -> list[NumberRun]:
    """Groups values by index into runs, in the order of their first indices."""
    places: dict[float, list[int]] = {}
    for place, value in sorted(numbers.items()):
        places.setdefault(value, []).append(place)
    runs = [run for value, at in places.items() for run in _runs(value, at)]
    return sorted(runs, key=lambda run: run.first)


def _runs(value: float, places: list[int]) -> list[NumberRun]:
    """Starts a run at each index and extends it while the distance stays the same."""
    runs: list[NumberRun] = []
    begin = 0
    while begin < len(places):
        end = begin + 1
        stride = places[end] - places[begin] if end < len(places) else 1
        while end < len(places) and places[end] - places[end - 1] == stride:
            end += 1
        if end - begin == 2:
            # two values are always equidistant
            end, stride = begin + 1, 1
        runs.append(NumberRun(value, places[begin], stride, end - begin))
        begin = end
    return runs

"""Finds arrays used by several layers and formulas of a file."""

from __future__ import annotations

from collections import Counter

from msnn.features.nnodely.saved_file.grammar import File, names_in


def shared_arrays(file: File) -> frozenset[str]:
    """Weights used in layers of different kinds, or also in a formula."""
    arrays = {*file.Parameters, *file.Constants}
    layers: set[tuple[str, ...]] = set()
    uses: Counter[str] = Counter()
    for kind, operands, *rest in file.Relations.values():
        uses.update({one for one in names_in(operands) if one in arrays})
        if kind in {"Fir", "Linear"} and len(rest) >= 2:
            # a set: equal layers are one in the spec, and use their arrays once
            layers.add((kind, *map(str, rest)))
    for _, weight, bias, *_ in layers:
        uses.update({weight, bias} & arrays)
    for function in file.Functions.values():
        uses.update(set(function.params_and_consts))
    return frozenset(name for name, count in uses.items() if count > 1)


def shared_across(file: File) -> frozenset[str]:
    """Arrays that layers use transposed: matrices of `Linear`."""
    layers = (rest for kind, _, *rest in file.Relations.values() if kind == "Linear")
    weights = {str(rest[0]) for rest in layers if rest}
    return shared_arrays(file) & weights

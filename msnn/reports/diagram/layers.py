"""Arranges boxes in layers from left to right (Sugiyama, Tagawa and Toda, 1981).

Every box is to the right of its inputs. A wire that crosses a layer is routed around its boxes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from graphlib import TopologicalSorter
from itertools import pairwise
from statistics import fmean

from msnn.reports.diagram.flow import Flow, Wire

Key = str | tuple[Wire, int]
"""A box by its name, or the bend of a wire in a layer."""
# as dot's order phase has it (Gansner et al. 1993): crossings hardly fall after that
_SWEEPS = 24
_BETWEEN_LAYERS = 56.0
_BETWEEN_BOXES = 20.0
_BETWEEN_BENDS = 12.0


@dataclass(frozen=True, slots=True)
class Size:
    width: float
    height: float


@dataclass(frozen=True, slots=True)
class BoxPlace:
    """The upper left corner of a box, and its size."""

    x: float
    y: float
    width: float
    height: float

    @property
    def middle(self) -> float:
        return self.y + self.height / 2


@dataclass(frozen=True, slots=True)
class DiagramLayout:
    """Positions of boxes, points of wires, and the total size."""

    places: Mapping[str, BoxPlace]
    paths: Mapping[Wire, tuple[tuple[float, float], ...]]
    """The bends of a forward wire: left and right end in each crossed layer."""
    width: float
    height: float


def laid_out(flow: Flow, sizes: Mapping[str, Size]) -> DiagramLayout:
    """The layout of boxes and forward wires; feedback wires do not affect it."""
    # the steps of the method: layers, bends of long wires, order in each layer, places
    layer_of = _layers(flow)
    layers: list[list[Key]] = [[] for _ in range(max(layer_of.values(), default=0) + 1)]
    for box in flow.boxes:
        layers[layer_of[box.name]].append(box.name)
    links: list[tuple[Key, Key]] = []
    for wire in flow.forward:
        # a long wire becomes a chain of bends: every link joins neighbouring layers
        chain: list[Key] = [wire.source]
        for number in range(layer_of[wire.source] + 1, layer_of[wire.target]):
            layers[number].append((wire, number))
            chain.append((wire, number))
        links += pairwise([*chain, wire.target])
    before: dict[Key, list[Key]] = {}
    after: dict[Key, list[Key]] = {}
    for source, target in links:
        after.setdefault(source, []).append(target)
        before.setdefault(target, []).append(source)
    _order(layers, before, after)
    heights = {key: _height(key, sizes) for layer in layers for key in layer}
    tops = _tops(layers, heights, before, after)
    return _placed(flow, layers, sizes, heights, tops)


def _layers(flow: Flow) -> dict[str, int]:
    """The layer of each box, by its longest path; inputs and states without wires are first.

    A box that only feeds distant layers moves towards them. Outputs are in the last layer.
    """
    sources: dict[str, list[str]] = {box.name: [] for box in flow.boxes}
    targets: dict[str, list[str]] = {box.name: [] for box in flow.boxes}
    for wire in flow.forward:
        sources[wire.target].append(wire.source)
        targets[wire.source].append(wire.target)
    found: dict[str, int] = {}
    # no recursion: a chain of equations may be longer than the stack of Python is deep
    for name in TopologicalSorter(sources).static_order():
        found[name] = max((found[source] + 1 for source in sources[name]), default=0)
    last = max(found.values(), default=0)
    # from the end of the spec: what a box feeds has moved before the box asks for it
    for box in reversed(flow.boxes):
        if box.kind == "outputs" and not targets[box.name]:
            found[box.name] = last
        elif box.kind in ("layers", "equations") and targets[box.name] and not sources[box.name]:
            found[box.name] = min(found[target] for target in targets[box.name]) - 1
    return found


def _order(
    layers: list[list[Key]], before: Mapping[Key, list[Key]], after: Mapping[Key, list[Key]]
) -> None:
    """Orders each layer by the mean position of neighbours; keeps the order with fewest
    crossings.
    """
    best = [list(layer) for layer in layers]
    least = _crossings(layers, after)
    for sweep in range(_SWEEPS):
        # alternately by the neighbours left and right: one side alone leaves the first layer as it
        # was
        forth = sweep % 2 == 0
        neighbours = before if forth else after
        numbers = range(1, len(layers)) if forth else range(len(layers) - 2, -1, -1)
        for number in numbers:
            beside = layers[number - 1 if forth else number + 1]
            layers[number] = _by_mean(layers[number], beside, neighbours)
        crossings = _crossings(layers, after)
        # a sweep may make it worse; the best seen is what counts
        if crossings < least:
            least, best = crossings, [list(layer) for layer in layers]
    layers[:] = best


def _by_mean(
    layer: Sequence[Key], beside: Sequence[Key], neighbours: Mapping[Key, list[Key]]
) -> list[Key]:
    """The layer sorted by the mean position of neighbours; unconnected boxes stay."""
    place = {key: index for index, key in enumerate(beside)}
    means: dict[Key, float] = {}
    for index, key in enumerate(layer):
        known = [place[each] for each in neighbours.get(key, ()) if each in place]
        # sorted() is stable: equal means keep their order, so that the picture is the same each
        # time
        means[key] = fmean(known) if known else float(index)
    return sorted(layer, key=means.__getitem__)


def _crossings(layers: Sequence[Sequence[Key]], after: Mapping[Key, list[Key]]) -> int:
    count = 0
    for left, right in pairwise(layers):
        place = {key: index for index, key in enumerate(right)}
        ends = [
            (index, place[target])
            for index, key in enumerate(left)
            for target in after.get(key, ())
            if target in place
        ]
        count += sum(
            # two wires between the same layers cross where their ends are in opposite orders
            (a - c) * (b - d) < 0
            for number, (a, b) in enumerate(ends)
            for c, d in ends[:number]
        )
    return count


def _height(key: Key, sizes: Mapping[str, Size]) -> float:
    # a bend is a point of a wire
    return sizes[key].height if isinstance(key, str) else 0.0


def _tops(
    layers: Sequence[Sequence[Key]],
    heights: Mapping[Key, float],
    before: Mapping[Key, list[Key]],
    after: Mapping[Key, list[Key]],
) -> dict[Key, float]:
    """The upper edge of each box: near the middle of its neighbours, in order, without overlap."""
    tops: dict[Key, float] = {}
    for layer in layers:
        y = 0.0
        for key in layer:
            tops[key] = y
            y += heights[key] + _gap(key)
    for sweep in range(_SWEEPS):
        forth = sweep % 2 == 0
        for layer in layers if forth else layers[::-1]:
            wanted: list[float] = []
            for key in layer:
                beside = [*before.get(key, ()), *after.get(key, ())]
                # first from one side alone, forth and back; then both sides settle it
                if sweep < _SWEEPS // 2:
                    beside = (before if forth else after).get(key, ()) or beside
                middles = [tops[each] + heights[each] / 2 for each in beside]
                middle = fmean(middles) if middles else tops[key] + heights[key] / 2
                wanted.append(middle - heights[key] / 2)
            tops |= _apart(layer, wanted, heights)
    least = min(tops.values(), default=0.0)
    return {key: top - least for key, top in tops.items()}


def _gap(key: Key) -> float:
    return _BETWEEN_BOXES if isinstance(key, str) else _BETWEEN_BENDS


def _apart(
    layer: Sequence[Key], wanted: Sequence[float], heights: Mapping[Key, float]
) -> dict[Key, float]:
    """The positions nearest to the desired ones, in order with gaps (pool adjacent violators)."""
    offsets: list[float] = []
    total = 0.0
    for key in layer:
        # places with these taken off are to be a sequence that never falls: isotonic regression
        offsets.append(total)
        total += heights[key] + _gap(key)
    pools: list[list[float]] = []
    # without the offsets places in order are numbers that do not fall
    for want, offset in zip(wanted, offsets, strict=True):
        pools.append([want - offset])
        # neighbours that would overlap become one pool at their mean, the nearest for least squares
        while len(pools) > 1 and fmean(pools[-2]) > fmean(pools[-1]):
            last = pools.pop()
            pools[-1] += last
    settled = [fmean(pool) for pool in pools for _ in pool]
    return {key: base + offset for key, base, offset in zip(layer, settled, offsets, strict=True)}


def _placed(
    flow: Flow,
    layers: Sequence[Sequence[Key]],
    sizes: Mapping[str, Size],
    heights: Mapping[Key, float],
    tops: Mapping[Key, float],
) -> DiagramLayout:
    places: dict[str, BoxPlace] = {}
    bends: dict[Wire, list[tuple[float, float]]] = {wire: [] for wire in flow.forward}
    x = 0.0
    for layer in layers:
        width = max((sizes[key].width for key in layer if isinstance(key, str)), default=0.0)
        for key in layer:
            if isinstance(key, str):
                # boxes of a layer are as wide as the widest: wires leave all of them at one line
                places[key] = BoxPlace(x, tops[key], width, sizes[key].height)
            else:
                # across the whole layer: a wire passes straight between boxes and curves only in
                # the gap
                bends[key[0]] += [(x, tops[key]), (x + width, tops[key])]
        x += width + _BETWEEN_LAYERS
    bottom = max((tops[key] + heights[key] for key in tops), default=0.0)
    paths = {wire: tuple(points) for wire, points in bends.items()}
    return DiagramLayout(places, paths, max(x - _BETWEEN_LAYERS, 0.0), bottom)

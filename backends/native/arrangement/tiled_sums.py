"""Sums of products with many of their results in registers at once, so that loads are shared.

A result at a time, each number of a row is loaded for each result again; a tile of p × q results
takes p + q loads for p · q multiply-adds.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

from backends.c_language.places import ArrayView, Index, variable
from backends.c_language.scope import BlockScope
from backends.c_language.tree import Binary, Expression, Loop, Name, Real

TIME = "t"
HORIZON = "horizon"
"""Names of the time and of the number of steps in the functions of a kernel."""

MOMENT = "@time"
"""The time among the axes of a result: no dim has this name, and `t` is that of windows."""

_RESULTS = 20
"""Results in registers: 32 registers hold these, their factors and what is on its way."""

_IN_A_ROW = 10
"""Results along one axis alone: more than enough to hide the latency of a multiply-add."""

_BESIDE = 5
"""Results along the second axis of a tile."""

_TIMES = 8
"""Times at once."""

Indices = Mapping[str, Index]
Store = Callable[[Indices, Expression, BlockScope], None]


@dataclass(frozen=True, slots=True)
class TimeLoop(Loop):
    """`for` over the times, `stop` at once; or over those that loops of `stop` leave over."""

    rest: bool = False


@dataclass(frozen=True, slots=True)
class Factor:
    """A factor of the product: where it stands at times 0 and 1, and its axes by name."""

    first: ArrayView
    second: ArrayView
    axes: tuple[str, ...]

    def element(self, time: Index, indices: Indices) -> Expression:
        # rows of one array are equally far apart, so two of them tell the distance of all
        step = self.second.offset.constant - self.first.offset.constant
        at = replace(self.first, offset=self.first.offset.plus(time.times(step)))
        return at.element([indices[axis] for axis in self.axes])


@dataclass(frozen=True, slots=True, kw_only=True)
class TiledSum:
    """result[axes] = Σ over `summed` of the product of the factors.

    `sizes` are those of all axes; the time has none and is either summed over or a result's first.
    """

    factors: Sequence[Factor]
    axes: tuple[str, ...]
    summed: tuple[str, ...]
    sizes: Mapping[str, int]
    over_time: bool
    """Whether the sum runs over the time; else there is a result at each time."""

    def write(self, scope: BlockScope, store: Store) -> None:
        """Loops over tiles; `store` takes each result, with its indices and the time as MOMENT."""
        tiles = self._tiles()
        if self.over_time:
            self._nest({}, self.axes, tiles, 1, scope, store)
            return
        # registers that the axes of a result leave are filled with results at several times
        among = 1
        for axis in self.axes:
            among *= tiles[axis]
        times = min(_TIMES, _RESULTS // among)
        # times come in tiles of `times`; the second loop takes those that are left over, one by one
        for rest in (False, True):
            inner = scope.inner()
            self._nest({}, self.axes, tiles, 1 if rest else times, inner, store)
            scope.add(TimeLoop(TIME, 0, times, tuple(inner.statements), rest=rest))

    def _tiles(self) -> dict[str, int]:
        """Results at once along each axis: the last two axes that are longer than 1 share them."""
        tiles = dict.fromkeys(self.axes, 1)
        long = [axis for axis in self.axes if self.sizes[axis] > 1][-2:]
        if self.over_time and len(long) == 1:
            tiles[long[0]] = _even(self.sizes[long[0]], _IN_A_ROW)
        elif long:
            # over the time the loads of both axes repeat at each time; else the times are the other
            # side
            first = long[0] if self.over_time else long[-1]
            # two axes: a tile of 5 × 4 loads 9 numbers for 20 products, a row of 20 would load 21
            tiles[first] = _even(self.sizes[first], _BESIDE)
            if self.over_time:
                tiles[long[1]] = _even(self.sizes[long[1]], _RESULTS // tiles[first])
        return tiles

    def _nest(
        self,
        begin: Indices,
        rest: Sequence[str],
        tiles: Mapping[str, int],
        times: int,
        scope: BlockScope,
        store: Store,
    ) -> None:
        """Loops over the tiles along the axes that are left, and what is left over of each."""
        if not rest:
            self._tile(begin, tiles, times, scope, store)
            return
        axis, *others = rest
        size, tile = self.sizes[axis], tiles[axis]
        full, over = divmod(size, tile)
        # one tile fills the axis: its loop would turn once
        if full == 1:
            self._nest({**begin, axis: Index()}, others, tiles, times, scope, store)
        else:
            with scope.loop(full) as (counter, inner):
                start = {**begin, axis: counter.times(tile)}
                self._nest(start, others, tiles, times, inner, store)
        if over:
            # what is left over is a tile of its own size behind the full ones
            start = {**begin, axis: Index(size - over)}
            self._nest(start, others, {**tiles, axis: over}, times, scope, store)

    def _tile(
        self, begin: Indices, tiles: Mapping[str, int], times: int, scope: BlockScope, store: Store
    ) -> None:
        """One tile: all its results begin at 0, grow together and are stored."""
        now = variable(TIME)
        results: list[tuple[Indices, Name]] = []
        for time, *offsets in product(range(times), *(range(tiles[axis]) for axis in self.axes)):
            indices = {
                axis: begin[axis].plus(Index(offset))
                for axis, offset in zip(self.axes, offsets, strict=True)
            }
            if not self.over_time:
                indices[MOMENT] = now.plus(Index(time))
            # a variable a result, not an array: compilers keep only named values in registers for
            # sure
            results.append((indices, scope.variable("sum", Real(0.0))))
        # sums over the time grow across all of it; else each time has sums of its own
        inner = scope.inner() if self.over_time else scope
        self._summed({}, self.summed, results, inner)
        if self.over_time:
            scope.add(TimeLoop(TIME, 0, 1, tuple(inner.statements)))
        for indices, total in results:
            store(indices, total, scope)

    def _summed(
        self,
        along: Indices,
        rest: Sequence[str],
        results: Sequence[tuple[Indices, Name]],
        scope: BlockScope,
    ) -> None:
        if rest:
            with scope.loop(self.sizes[rest[0]]) as (counter, inner):
                self._summed({**along, rest[0]: counter}, rest[1:], results, inner)
            return
        loaded: dict[Expression, Name] = {}
        for indices, total in results:
            where = {MOMENT: variable(TIME), **indices, **along}
            term: Expression | None = None
            for factor in self.factors:
                element = factor.element(where[MOMENT], where)
                # results of a tile share factors: this is what tiles are for
                if element not in loaded:
                    loaded[element] = scope.constant("factor", element)
                name = loaded[element]
                term = name if term is None else Binary("*", term, name)
            assert term is not None
            scope.assign(total, Binary("+", total, term))


def _even(size: int, most: int) -> int:
    """The length of tiles that cover the size with as few as possible, all about as long."""
    # rounded up twice: as few tiles as cover the axis, then as short as that number allows
    tiles = -(-size // most)
    return -(-size // tiles)

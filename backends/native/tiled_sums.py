"""Sums of products, computed in tiles with many results in registers, to share loads.

One result at a time, every element of a row is loaded again for each result. A tile of p × q
results needs p + q loads for p · q multiply-adds.
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
"""The time among the axes of a result: no dim has this name, and `t` is the window."""

_RESULTS = 20
"""Maximum number of results in registers; 32 registers also hold factors and temporaries."""

_IN_A_ROW = 10
"""Maximum number of results along a single axis, enough to hide the latency of a multiply-add."""

_BESIDE = 5
"""Maximum number of results along the second axis of a tile."""

_TIMES = 8
"""Maximum number of times per tile."""

Indices = Mapping[str, Index]
Store = Callable[[Indices, Expression, BlockScope], None]


@dataclass(frozen=True, slots=True)
class TimeLoop(Loop):
    """A C loop over time that handles `stop` times per iteration. With `rest`, it runs over the
    times that remain after such a loop, one per iteration.
    """

    rest: bool = False


@dataclass(frozen=True, slots=True)
class Factor:
    """A factor of a product as an array over time: its places at times 0 and 1, and the names of
    its axes.
    """

    first: ArrayView
    second: ArrayView
    axes: tuple[str, ...]

    def element(self, time: Index, indices: Indices) -> Expression:
        # rows are equidistant, so two of them give the stride
        step = self.second.offset.constant - self.first.offset.constant
        at = replace(self.first, offset=self.first.offset.plus(time.times(step)))
        return at.element([indices[axis] for axis in self.axes])


@dataclass(frozen=True, slots=True, kw_only=True)
class TiledSum:
    """result[axes] = Σ over the axes `summed` of the product of the factors. `sizes` has the sizes
    of all axes by name. Time is not among them: it is either summed over, or the result exists for
    each time.
    """

    factors: Sequence[Factor]
    axes: tuple[str, ...]
    summed: tuple[str, ...]
    sizes: Mapping[str, int]
    over_time: bool
    """True if the sum runs over time; otherwise there is one result per time."""

    def write(self, scope: BlockScope, store: Store) -> None:
        """Writes loops over tiles of results. `store(indices, value, scope)` writes a statement
        that uses a result; its indices by axis include the time as MOMENT unless it was summed
        over.
        """
        tiles = self._tiles()
        if self.over_time:
            self._nest({}, self.axes, tiles, 1, scope, store)
            return
        # remaining registers are used for several times
        among = 1
        for axis in self.axes:
            among *= tiles[axis]
        times = min(_TIMES, _RESULTS // among)
        # tiles of `times` times; the second loop handles the remaining times one by one
        for rest in (False, True):
            inner = scope.inner()
            self._nest({}, self.axes, tiles, 1 if rest else times, inner, store)
            scope.add(TimeLoop(TIME, 0, times, tuple(inner.statements), rest=rest))

    def _tiles(self) -> dict[str, int]:
        """The number of results per tile along each axis, by name; only the last one or two axes
        longer than 1 have more than one.
        """
        tiles = dict.fromkeys(self.axes, 1)
        long = [axis for axis in self.axes if self.sizes[axis] > 1][-2:]
        if self.over_time and len(long) == 1:
            tiles[long[0]] = _even(self.sizes[long[0]], _IN_A_ROW)
        elif long:
            # a sum over time tiles two axes; otherwise time is the second axis of the tile
            first = long[0] if self.over_time else long[-1]
            # a 5 × 4 tile needs 9 loads for 20 products, a row of 20 results needs 21
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
        """Writes loops over the tiles along the axes `rest`, with a smaller tile at the end of an
        axis. `begin` are the first indices of the tile along the other axes; a tile has `times`
        times.
        """
        if not rest:
            self._tile(begin, tiles, times, scope, store)
            return
        axis, *others = rest
        size, tile = self.sizes[axis], tiles[axis]
        full, over = divmod(size, tile)
        # one tile covers the axis: no loop
        if full == 1:
            self._nest({**begin, axis: Index()}, others, tiles, times, scope, store)
        else:
            with scope.loop(full) as (counter, inner):
                start = {**begin, axis: counter.times(tile)}
                self._nest(start, others, tiles, times, inner, store)
        if over:
            # the remainder is a smaller tile after the full ones
            start = {**begin, axis: Index(size - over)}
            self._nest(start, others, {**tiles, axis: over}, times, scope, store)

    def _tile(
        self, begin: Indices, tiles: Mapping[str, int], times: int, scope: BlockScope, store: Store
    ) -> None:
        """Writes one tile of results: variables initialised with 0, the loops that sum, and what
        `store` writes.

        `begin` are the first indices of the tile, `tiles` its sizes by axis, `times` its size along
        the time axis.
        """
        now = variable(TIME)
        results: list[tuple[Indices, Name]] = []
        for time, *offsets in product(range(times), *(range(tiles[axis]) for axis in self.axes)):
            indices = {
                axis: begin[axis].plus(Index(offset))
                for axis, offset in zip(self.axes, offsets, strict=True)
            }
            if not self.over_time:
                indices[MOMENT] = now.plus(Index(time))
            # one variable per result: compilers keep arrays in memory
            results.append((indices, scope.variable("sum", Real(0.0))))
        # a sum over time accumulates over all times; otherwise each time has its own sums
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
                # results of a tile share factors
                if element not in loaded:
                    loaded[element] = scope.constant("factor", element)
                name = loaded[element]
                term = name if term is None else Binary("*", term, name)
            assert term is not None
            scope.assign(total, Binary("+", total, term))


def _even(size: int, most: int) -> int:
    """Splits `size` results into the fewest tiles of at most `most` results, as equal as possible;
    returns the length of a tile. The last tile may be shorter.
    """
    # the smallest number of tiles, then the shortest length for this number
    tiles = -(-size // most)
    return -(-size // tiles)

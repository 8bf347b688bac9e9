"""Chooses golden steps in which both sides of comparisons are equal, to tell `<` from `<=`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from compiler.ir.ops import Relation
from msnn.features.fixed_point.golden.golden import GoldenWords, answered, drawn
from msnn.features.fixed_point.integers.interpret import IntegerState, evaluated, reset, step
from msnn.features.fixed_point.integers.program import (
    Choose,
    IntegerNode,
    IntegerProgram,
    ReadMemory,
    ReadWord,
    WordPort,
    reached,
)

_MOST_RUNS = 6
_MOST_WORK = 200_000
"""Maximum number of integer operations of the search, less than a second."""
_PROBES = 6
"""Number of words inside a range, besides its ends, at which the sign is evaluated."""
_TRIED = 2
"""Maximum number of words of a step that are tried for a comparison."""
_OFTEN = 3
"""Maximum number of failed searches for a comparison in a run, or of equalities without effect."""

_OTHER = {
    Relation.LESS: Relation.LESS_EQUAL,
    Relation.LESS_EQUAL: Relation.LESS,
    Relation.GREATER: Relation.GREATER_EQUAL,
    Relation.GREATER_EQUAL: Relation.GREATER,
}
"""The relation that differs only at equality."""

Words = dict[str, list[int]]


def golden_equalities(program: IntegerProgram, steps: int, seed: int) -> list[GoldenWords]:
    """Runs of `steps` steps in which both sides of as many comparisons as possible are equal.

    For each choice and each limit of an equation, a search moves one word until both sides are
    equal. The word belongs to a step, the step before or the samples around the first step; all
    others are random. The search continues until the other result at equality would change outputs
    or status; at a kink it never does. Comparisons whose sides are never equal have no run.
    """
    pending = list(_comparisons(program))
    search = _Search(program, np.random.Generator(np.random.Philox(seed)))
    found: list[GoldenWords] = []
    # each run draws anew: what one begins with may keep a comparison from ever being met
    for _ in range(_MOST_RUNS):
        if not pending or search.work > _MOST_WORK:
            break
        run, met = search.run(pending, steps)
        seen = {one for one in met if _answers_differ(run, one.broken)}
        # a first meeting is kept even where it makes no difference: other changes of the C may show
        # there
        if seen or any(search.met[one] == 1 for one in met):
            found.append(run)
        pending = [one for one in pending if one not in seen and not search.is_over(one)]
    return found


@dataclass(frozen=True, slots=True, eq=False)
class _Comparison:
    """A comparison of a program: the nodes needed to compute it, and a function that returns the
    difference of its sides from their values.
    """

    nodes: tuple[IntegerNode, ...]
    apart: Callable[[Sequence[int]], int]
    broken: IntegerProgram
    """The same program with the other result at equality."""
    at_start: bool = False
    """True if it belongs to the start, which reads samples around the first step."""

    @property
    def words(self) -> list[tuple[str, int]]:
        """The elements of inputs on which it depends, as (port, index)."""
        ops = (node.op for node in self.nodes)
        return [(op.port, op.index) for op in ops if isinstance(op, ReadWord)]

    @property
    def remembers(self) -> bool:
        """True if it depends on memories."""
        return any(isinstance(node.op, ReadMemory) for node in self.nodes)


def _comparisons(program: IntegerProgram) -> Iterator[_Comparison]:
    for index, node in enumerate(program.step):
        if isinstance(node.op, Choose):
            broken = replace(program, step=_with_other(program.step, index, node.op))
            yield _comparison(program.step, node.args[:2], 0, broken)
    for index, node in enumerate(program.start):
        if isinstance(node.op, Choose):
            broken = replace(program, start=_with_other(program.start, index, node.op))
            found = _comparison(program.start, node.args[:2], 0, broken)
            yield replace(found, at_start=True)
    for place, entry in enumerate(program.expected):
        for k, node in enumerate(entry.nodes):
            # limits one unit further inside count the limit itself as outside: the other answer at
            # equality
            for end, (low, high) in ((entry.low[k], (1, 0)), (entry.high[k], (0, -1))):
                inner = replace(
                    entry,
                    low=(*entry.low[:k], entry.low[k] + low, *entry.low[k + 1 :]),
                    high=(*entry.high[:k], entry.high[k] + high, *entry.high[k + 1 :]),
                )
                every = (*program.expected[:place], inner, *program.expected[place + 1 :])
                yield _comparison(program.step, (node,), end, replace(program, expected=every))


def _with_other(nodes: tuple[IntegerNode, ...], index: int, op: Choose) -> tuple[IntegerNode, ...]:
    other = replace(nodes[index], op=Choose(_OTHER[op.relation]))
    return (*nodes[:index], other, *nodes[index + 1 :])


def _comparison(
    graph: tuple[IntegerNode, ...], sides: tuple[int, ...], end: int, broken: IntegerProgram
) -> _Comparison:
    """The comparison of two nodes of `graph`, or of one node with the constant `end`; `sides` has
    two or one index.
    """
    nodes, places = reached(graph, sides)
    left = places[sides[0]]
    if len(sides) == 1:
        return _Comparison(nodes, lambda values: values[left] - end, broken)
    right = places[sides[1]]
    return _Comparison(nodes, lambda values: values[left] - values[right], broken)


def _answers_differ(run: GoldenWords, broken: IntegerProgram) -> bool:
    other = answered(broken, run.start.windows, run.inputs)
    return (run.outputs, run.status) != (other.outputs, other.status)


@dataclass(slots=True)
class _Search:
    """Searches for words of steps and counts the integer operations of the search."""

    program: IntegerProgram
    random: np.random.Generator
    work: int = 0
    met: Counter[_Comparison] = field(default_factory=Counter[_Comparison])
    ports: dict[str, WordPort] = field(init=False)

    def __post_init__(self) -> None:
        self.ports = {entry.port.name: entry.port for entry in self.program.inputs}

    def is_over(self, one: _Comparison) -> bool:
        """True if further equalities of this comparison are useless."""
        return self.met[one] >= _OFTEN

    def run(
        self, pending: Sequence[_Comparison], steps: int
    ) -> tuple[GoldenWords, set[_Comparison]]:
        """A run of `steps` steps in which the search tries one comparison after the other, and the
        comparisons that were made equal.
        """
        program = self.program
        order = [pending[k] for k in _shuffled(len(pending), self.random)]
        # what begins is in round numbers: from there on sides that are remembered may be equal
        in_steps = sorted(
            (one for one in order if not one.at_start), key=lambda one: not one.remembers
        )
        met: set[_Comparison] = set()
        missed: Counter[_Comparison] = Counter()
        windows = {port.name: drawn(port, self.random) for port in program.windows}
        inputs = [self._drawn()]
        met |= self._begin(order, windows, inputs[0])
        state = reset(program, windows)
        for k in range(1, steps + 1):
            inputs.append(self._drawn())
            wanted = next((one for one in in_steps if one not in met), None)
            if wanted is not None and self.work < _MOST_WORK:
                # to the end of the queue, so that each gets its turn before one gets two
                in_steps = [*(one for one in in_steps if one is not wanted), wanted]
                if self._meet_now(wanted, state, inputs[k - 1]) or self._meet_next(
                    wanted, state, inputs[k - 1], inputs[k]
                ):
                    met.add(wanted)
                else:
                    missed[wanted] += 1
                    in_steps = [one for one in in_steps if missed[one] < _OFTEN]
            step(program, state, inputs[k - 1])
        self.met.update(met)
        return answered(program, windows, inputs[:steps]), met

    def _drawn(self) -> Words:
        return {name: drawn(port, self.random) for name, port in self.ports.items()}

    def _begin(
        self, order: Sequence[_Comparison], windows: Words, words: Words
    ) -> set[_Comparison]:
        """Moves one word of `windows` so that a comparison becomes equal in the start or in the
        first step, whose inputs are `words`. Returns that comparison in a set, or an empty set.
        """
        ports = {port.name: port for port in self.program.windows}
        places = [(name, k) for name, port in ports.items() for k in range(port.size)]
        wanted = next((one for one in order if one.at_start or one.remembers), None)
        if wanted is None or not places:
            return set()

        def apart() -> int:
            self.work += len(self.program.start)
            if wanted.at_start:
                return wanted.apart(evaluated(wanted.nodes, windows, {}))
            return self._apart(wanted, reset(self.program, windows), words)

        if self._move(windows, places, ports, apart):
            return {wanted}
        return set()

    def _meet_now(self, wanted: _Comparison, state: IntegerState, words: Words) -> bool:
        return self._move(
            words, wanted.words, self.ports, lambda: self._apart(wanted, state, words)
        )

    def _meet_next(
        self, wanted: _Comparison, state: IntegerState, words: Words, following: Words
    ) -> bool:
        """Moves one of the input `words` of this step so that the sides are equal in the next step,
        whose inputs are `following`; True if successful.
        """
        if not wanted.remembers:
            return False
        places = [(name, k) for name, port in self.ports.items() for k in range(port.size)]

        def apart() -> int:
            self.work += len(self.program.step)
            after = replace(state, held=dict(state.held))  # a step replaces the rest
            step(self.program, after, words)
            return self._apart(wanted, after, following)

        return self._move(words, places, self.ports, apart)

    def _apart(self, wanted: _Comparison, state: IntegerState, words: Words) -> int:
        self.work += len(wanted.nodes)
        return wanted.apart(evaluated(wanted.nodes, words, state.memories))

    def _move(
        self,
        words: Words,
        places: Sequence[tuple[str, int]],
        ports: dict[str, WordPort],
        apart: Callable[[], int],
    ) -> bool:
        """Moves one of the words at `places` (port, index) until `apart`, the difference of both
        sides, is 0. Returns False, with all words unchanged, if none succeeds.
        """
        # few words a time: most comparisons depend on most words, and a miss costs a whole search
        for place in _shuffled(len(places), self.random)[:_TRIED]:
            name, element = places[place]
            before = words[name][element]

            def at(word: int, values: list[int] = words[name], element: int = element) -> int:
                values[element] = word
                return apart()

            found = self._root(at, ports[name])
            words[name][element] = before if found is None else found
            if found is not None:
                return True
        return False

    def _root(self, function: Callable[[int], int], port: WordPort) -> int | None:
        """A word in the range of `port` at which the function is 0, searched between words of
        different signs; None if none is found.
        """
        # sides need not differ monotonically: between ends of one sign there may be two roots
        inside = self.random.integers(port.low, port.high, _PROBES, endpoint=True).tolist()
        known = [(word, function(word)) for word in sorted({port.low, *inside, port.high})]
        for (low, below), (high, above) in pairwise(known):
            for word, value in ((low, below), (high, above)):
                if value == 0:
                    return word
            if (below < 0) == (above < 0):
                continue
            # bisection on integers: neighbours of different signs have no word between them
            while high - low > 1:
                middle = (low + high) // 2
                value = function(middle)
                if value == 0:
                    return middle
                low, high = (middle, high) if (value < 0) == (below < 0) else (low, middle)
        return None


def _shuffled(count: int, random: np.random.Generator) -> list[int]:
    return [int(place) for place in random.permutation(count)]

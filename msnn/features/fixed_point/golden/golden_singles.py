"""Chooses golden steps from written memories: both sides of every decision, and extremes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from msnn.features.fixed_point.golden.golden import drawn
from msnn.features.fixed_point.integers.interpret import IntegerState, evaluated, initial, step
from msnn.features.fixed_point.integers.program import (
    Choose,
    IntegerLookup,
    IntegerNode,
    IntegerProgram,
    Larger,
    ReadMemory,
    ReadWord,
    Smaller,
    reached,
)

_MOST = 160
_MOST_NUMBERS = 12_000
"""Maximum number of elements in memories and ports of all steps: data of a test program."""
_MOST_WORK = 200_000
"""Maximum number of integer operations of the search, less than a second."""
_MOST_KNOTS = 8
"""Maximum number of knots per table."""

Numbers = dict[str, list[int]]
_Place: TypeAlias = tuple[bool, str, int]
"""True for a memory, False for an input; its name; the index of the element."""


@dataclass(frozen=True, slots=True)
class GoldenSingle:
    """A single golden step in words: the memories before it and after it (`following`), inputs,
    outputs and status.
    """

    memories: Numbers
    inputs: Numbers
    outputs: Numbers
    following: Numbers
    status: int


def golden_singles(program: IntegerProgram, seed: int) -> list[GoldenSingle]:
    """Single steps on both sides of every decision of a step, which short runs may never reach;
    empty for a program without memories and inputs.

    A memory may start with any value within its limits, since the bounds of all nodes hold for
    these. Decisions are comparisons, minima, maxima, limits of memories and equations, and knots of
    tables. Each has the steps with the smallest and largest difference of both sides. It also has
    pairs of steps with different signs that differ by 1 in one element.
    """
    if not program.memories and not program.inputs:
        return []
    search = _Search(program, np.random.Generator(np.random.Philox(seed)))
    size = sum(memory.size for memory in program.memories)
    size += sum(entry.port.size for entry in program.inputs)
    most = min(_MOST, _MOST_NUMBERS // size)
    found: dict[tuple[tuple[int, ...], ...], _Trial] = {}
    for decision in _decisions(program):
        if len(found) >= most or search.work > _MOST_WORK:
            break
        for trial in search.beside(decision):
            found.setdefault(trial.numbers, trial)
    return [_answered(program, trial) for trial in [*found.values()][:most]]


@dataclass(frozen=True, slots=True)
class _Decision:
    """Two nodes, or a node and the constant `end` (`right` is None), whose order decides; `nodes`
    are all that they need, and `left` and `right` are indices in it.
    """

    nodes: tuple[IntegerNode, ...]
    left: int
    right: int | None
    end: int

    def apart(self, values: Sequence[int]) -> int:
        return values[self.left] - (self.end if self.right is None else values[self.right])

    def places(self) -> list[_Place]:
        """The elements of memories and inputs on which it depends."""
        found: dict[_Place, None] = {}
        for node in self.nodes:
            match node.op:
                case ReadMemory(memory, index):
                    found[True, memory, index] = None
                case ReadWord(port, index):
                    found[False, port, index] = None
                case _:
                    pass
        return [*found]


def _decisions(program: IntegerProgram) -> list[_Decision]:
    """All decisions of a step: comparisons first, since their branches differ most."""
    step = program.step
    compared = [n for n in step if isinstance(n.op, Choose)]
    bent = [n for n in step if isinstance(n.op, Smaller | Larger)]
    found = [_decision(step, node.args[0], node.args[1]) for node in compared]
    found += [_decision(step, node, None, end) for node, end in _limits(program)]
    found += [_decision(step, node.args[0], node.args[1]) for node in bent]
    for node in step:
        if isinstance(node.op, IntegerLookup):
            cells = len(node.op.values) - 1
            knots = range(0, cells + 1, 1 + cells // _MOST_KNOTS)
            ends = [node.op.first + (knot << node.op.bits) for knot in knots]
            found += [_decision(step, node.args[0], None, end) for end in ends]
    return found


def _limits(program: IntegerProgram) -> Iterator[tuple[int, int]]:
    """Pairs of a node that may exceed a limit of a memory or an equation, and this limit."""
    for memory in program.memories:
        for node in dict.fromkeys(memory.next):
            if program.step[node].low < memory.low:
                yield node, memory.low
            if program.step[node].high > memory.high:
                yield node, memory.high
    for entry in program.expected:
        for node, low, high in zip(entry.nodes, entry.low, entry.high, strict=True):
            yield node, low
            yield node, high


def _decision(
    step: tuple[IntegerNode, ...], left: int, right: int | None, end: int = 0
) -> _Decision:
    nodes, places = reached(step, (left,) if right is None else (left, right))
    return _Decision(nodes, places[left], None if right is None else places[right], end)


@dataclass(frozen=True, slots=True)
class _Trial:
    memories: Numbers
    inputs: Numbers

    @property
    def numbers(self) -> tuple[tuple[int, ...], ...]:
        return tuple(map(tuple, (*self.memories.values(), *self.inputs.values())))

    def at(self, place: _Place) -> int:
        of_memory, name, element = place
        return (self.memories if of_memory else self.inputs)[name][element]

    def put(self, place: _Place, number: int) -> None:
        of_memory, name, element = place
        (self.memories if of_memory else self.inputs)[name][element] = number

    def copy(self) -> _Trial:
        return _Trial(*({n: [*v] for n, v in of.items()} for of in (self.memories, self.inputs)))


@dataclass(slots=True)
class _Search:
    """Searches for steps and counts the integer operations of the search."""

    program: IntegerProgram
    random: np.random.Generator
    work: int = 0

    def beside(self, decision: _Decision) -> Iterator[_Trial]:
        """Yields steps on both sides of one decision: the two extremes, then pairs next to
        equality.
        """
        drawn_one = self._drawn()
        low, high = (self._farthest(decision, drawn_one, sign) for sign in (-1, 1))
        yield low
        yield high
        if self._apart(decision, low) < 0 < self._apart(decision, high):
            # below and equal, equal and above: the same two where the sides are never equal
            for least in (0, 1):
                yield from self._between(decision, low, high, least)

    def _drawn(self) -> _Trial:
        memories = {
            m.name: [int(x) for x in self.random.integers(m.low, m.high, m.size, endpoint=True)]
            for m in self.program.memories
        }
        ports = [entry.port for entry in self.program.inputs]
        return _Trial(memories, {port.name: drawn(port, self.random) for port in ports})

    def _limits(self, place: _Place) -> tuple[int, int]:
        of_memory, name, _ = place
        if of_memory:
            memory = next(m for m in self.program.memories if m.name == name)
            return memory.low, memory.high
        port = next(e.port for e in self.program.inputs if e.port.name == name)
        return port.low, port.high

    def _farthest(self, decision: _Decision, begin: _Trial, sign: int) -> _Trial:
        """A step from `begin` whose elements are moved, one after the other, to the limit that
        increases `sign` times the difference of both sides most.
        """
        best, reach = begin.copy(), sign * self._apart(decision, begin)
        for place in decision.places():
            before = best.at(place)
            for number in self._limits(place):
                best.put(place, number)
                found = sign * self._apart(decision, best)
                if found > reach:
                    before, reach = number, found
            best.put(place, before)
        return best

    def _between(
        self, decision: _Decision, low: _Trial, high: _Trial, least: int
    ) -> Iterator[_Trial]:
        """Yields two adjacent steps on the way from `low` to `high`, between which the difference
        of both sides reaches `least`.
        """
        here = low.copy()
        for place in decision.places():
            left, right = here.at(place), high.at(place)
            here.put(place, right)
            if self._apart(decision, here) < least:
                continue
            while abs(right - left) > 1:
                middle = (left + right) // 2
                here.put(place, middle)
                if self._apart(decision, here) < least:
                    left = middle
                else:
                    right = middle
            for number in (left, right):
                here.put(place, number)
                yield here.copy()
            return

    def _apart(self, decision: _Decision, trial: _Trial) -> int:
        self.work += len(decision.nodes)
        return decision.apart(evaluated(decision.nodes, trial.inputs, trial.memories))


def _answered(program: IntegerProgram, trial: _Trial) -> GoldenSingle:
    state = IntegerState(memories=trial.copy().memories, held=initial(program).held)
    answer = step(program, state, trial.inputs)
    return GoldenSingle(
        trial.memories, trial.inputs, answer.outputs, state.memories, int(answer.status)
    )

"""Writes initial values and updates of memories, and the treatment of words out of range."""

from __future__ import annotations

from collections.abc import Sequence

from backends.c_language import tree as c
from backends.c_language.places import Index
from backends.c_language.scope import BlockScope
from backends.c_lowering.sums import in_blocks
from compiler.ir.types import Axis
from msnn.features.fixed_point.backend.helpers import FixedHelpers
from msnn.features.fixed_point.backend.integer_nodes import IntegerNodes, neighbours
from msnn.features.fixed_point.backend.structs import FixedNames
from msnn.features.fixed_point.integers.program import (
    CheckedInput,
    IntegerMemory,
    IntegerNode,
    IntegerProgram,
    ReadMemory,
    ReadWord,
    WordPort,
)

_BLOCK = 4
"""Samples that one iteration of a loop copies."""


def element(base: c.Expression, axes: Sequence[Axis], at: Index) -> c.Expression:
    """The C expression of the element at an index of an array in C order; for a scalar, which has
    no axes, the variable itself.
    """
    return c.Element(base, at.expression()) if axes else base


class MemoryWriter:
    """Writes C statements about memories into `scope`, a block of one function."""

    def __init__(
        self, program: IntegerProgram, names: FixedNames, helpers: FixedHelpers, scope: BlockScope
    ) -> None:
        self._program, self._names = program, names
        self._helpers, self._scope = helpers, scope

    def element(self, memory: IntegerMemory, at: Index) -> c.Expression:
        """The C expression of the element `at` of a memory in the state struct."""
        return element(c.Member("s", self._names.memories[memory.name]), memory.axes, at)

    def set(self, memory: IntegerMemory, values: Sequence[int]) -> None:
        """Writes the assignment of constants to a memory, one per element."""
        if memory.axes and len(set(values)) == 1:
            # an array of one value, mostly zeros, takes a loop: its turns written out would cost
            # flash
            with self._scope.loop(len(values)) as (along, inner):
                inner.assign(self.element(memory, along), _known(memory, values[0]))
            return
        for index, value in enumerate(values):
            self._scope.assign(self.element(memory, Index(index)), _known(memory, value))

    def fill(self, memory: IntegerMemory, words: Sequence[c.Expression]) -> None:
        """Writes the filling of a buffer: all samples of a row become copies of the row's word.
        `words` has one expression per row.
        """
        # C order with time last, (rows, samples): each row has one newest word
        samples = memory.size // len(words)
        for row, word in enumerate(words):
            with self._scope.loop(samples) as (along, inner):
                inner.assign(self.element(memory, along.plus(Index(row * samples))), word)

    def start(self, memory: IntegerMemory, nodes: IntegerNodes, saturated: c.Statement) -> None:
        """Writes the assignment of a memory's start, from the start nodes in `nodes`. The statement
        `saturated` runs if a value exceeds the limits and is limited.
        """
        for begin, count in neighbours([self._program.start[node] for node in memory.start]):
            if not self._copied(memory, self._program.start, memory.start, begin, count, nodes):
                for index in range(begin, begin + count):
                    self._keep(memory, index, memory.start[index], nodes, (saturated,))

    def commit(
        self,
        memory: IntegerMemory,
        nodes: IntegerNodes,
        saturated: c.Statement,
        restart: Sequence[int] | None = None,
    ) -> None:
        """Writes the update of a memory from the step nodes in `nodes`. The statement `saturated`
        runs if a next value exceeds its limits and is limited.

        With `restart`, one value per element, the whole memory is then set to these values.
        """
        graph = self._program.step
        if restart is None or all(_fits(memory, graph[node]) for node in memory.next):
            self._commit(memory, nodes, (saturated,))
            return
        # elements are judged one after the other; whether the array starts anew is known after the
        # last
        left = c.Name(self._scope.fresh(f"{self._names.memories[memory.name]}_left"))
        self._scope.add(c.Declare(c.CType.BOOL, left.text, c.Truth(False)))
        self._commit(memory, nodes, (c.Assign(left, c.Truth(True)),))
        inner = self._scope.inner()
        # the bit once for all elements, then the whole array: half of a state from before would be
        # a state that no step ever reached
        inner.add(saturated)
        MemoryWriter(self._program, self._names, self._helpers, inner).set(memory, restart)
        self._scope.add(c.If(left, tuple(inner.statements)))

    def _commit(
        self, memory: IntegerMemory, nodes: IntegerNodes, too_large: tuple[c.Statement, ...]
    ) -> None:
        for begin, count in neighbours([self._program.step[node] for node in memory.next]):
            if self._copied(memory, self._program.step, memory.next, begin, count, nodes):
                continue
            for index in range(begin, begin + count):
                self._keep(memory, index, memory.next[index], nodes, too_large)

    def _keep(
        self,
        memory: IntegerMemory,
        index: int,
        node: int,
        nodes: IntegerNodes,
        too_large: tuple[c.Statement, ...],
    ) -> None:
        """Writes the assignment of a node to the element `index`; the statements `too_large` run if
        it exceeds the limits.
        """
        found, target = nodes.node(node), self.element(memory, Index(index))
        self._scope.assign(target, self._stored(nodes, node, memory, found))
        if not _fits(memory, found):
            # it was limited where what is stored is not what was computed
            changed = c.Binary("!=", target, nodes.value(node))
            self._scope.add(c.If(changed, too_large))

    def _copied(
        self,
        memory: IntegerMemory,
        graph: Sequence[IntegerNode],
        elements: Sequence[int],
        begin: int,
        count: int,
        nodes: IntegerNodes,
    ) -> bool:
        """Writes a loop if the elements begin … begin + count − 1 are only copied from adjacent
        elements. Returns False, and writes nothing, if no loop is possible.

        `elements` are the nodes of `graph` for all elements of the memory. The loop runs in
        ascending order.
        """
        moved = elements[begin : begin + count]
        op = graph[moved[0]].op
        whole = all(nodes.is_inline(node) and _fits(memory, graph[node]) for node in moved)
        # a wide memory holds sums, ports hold words: a loop over both would need a conversion in
        # it, which `_keep` writes for each element
        if count == 1 or memory.wide or not whole or not isinstance(op, ReadWord | ReadMemory):
            return False

        def move(along: Index, inner: BlockScope) -> None:
            source = nodes.element(op, along.plus(Index(op.index)))
            inner.assign(self.element(memory, along.plus(Index(begin))), source)

        in_blocks(count, _BLOCK, self._scope, move)
        return True

    def _stored(
        self, nodes: IntegerNodes, node: int, memory: IntegerMemory, found: IntegerNode
    ) -> c.Expression:
        """The C expression of a node, limited to the memory's range if it may exceed it, in the
        type of the memory.
        """
        if _fits(memory, found):
            return nodes.value(node) if memory.wide else nodes.as_word(node)
        limited = self._helpers.limited(nodes.value(node), memory.low, memory.high)
        return limited if memory.wide else c.Convert(c.CType.WORD, limited)


def _fits(memory: IntegerMemory, found: IntegerNode) -> bool:
    return found.low >= memory.low and found.high <= memory.high


def _known(memory: IntegerMemory, value: int) -> c.Expression:
    return c.Integer(value) if memory.wide else c.Convert(c.CType.WORD, c.Integer(value))


def word_of(port: WordPort, field: str, at: Index) -> c.Expression:
    """The element at this index of the local variable with the words of a port."""
    return element(c.Name(f"w_{field}"), port.axes, at)


def check_window(
    port: WordPort, field: str, report: c.Statement, helpers: FixedHelpers, scope: BlockScope
) -> None:
    """Writes the check of a window for `reset`: its words are limited to their range, and the
    statement `report` runs if one was outside. `field` is the window's C name.
    """
    _check(port, c.Member("x0", field), field, None, (report, helpers, scope))


def check_input(
    entry: CheckedInput,
    names: FixedNames,
    report: c.Statement,
    helpers: FixedHelpers,
    scope: BlockScope,
) -> None:
    """Writes the check of an input for `step`: its words are limited, or held by its policy, and
    the statement `report` runs if one was out of range.
    """
    port, field = entry.port, names.inputs[entry.port.name]
    held = names.held.get(port.name)
    kept = None if held is None else c.Member("s", held)
    _check(port, c.Member("u", field), field, kept, (report, helpers, scope))


def _check(
    port: WordPort,
    given: c.Expression,
    field: str,
    held: c.Expression | None,
    writing: tuple[c.Statement, FixedHelpers, BlockScope],
) -> None:
    report, helpers, scope = writing
    local = f"w_{field}"
    if port.axes:
        scope.add(c.Declare(c.CType.WORD, local, size=port.size))
        with scope.loop(port.size) as (along, inner):
            # the local is what the step reads: the caller's struct is const and may be shared by
            # models
            word = word_of(port, field, along)
            raw = c.Element(given, along.expression())
            inner.assign(word, _limited(raw, port, helpers))
            kept = None if held is None else c.Element(held, along.expression())
            _replace(word, raw, kept, report, inner)
        return
    limited = _limited(given, port, helpers)
    scope.add(c.Declare(c.CType.WORD, local, limited, constant=held is None))
    _replace(c.Name(local), given, held, report, scope)


def _replace(
    word: c.Expression,
    raw: c.Expression,
    held: c.Expression | None,
    report: c.Statement,
    scope: BlockScope,
) -> None:
    """Writes the report of a `word` that differs from the given word `raw`, as it was limited. With
    the policy `hold`, the last valid word `held` replaces it.
    """
    inner = scope.inner()
    if held is not None:
        inner.assign(word, held)
    inner.add(report)
    scope.add(c.If(c.Binary("!=", word, raw), tuple(inner.statements)))
    if held is not None:
        # in any case: a valid word is what the next step holds, an invalid one was replaced by it
        scope.assign(held, word)


def _limited(raw: c.Expression, port: WordPort, helpers: FixedHelpers) -> c.Expression:
    return c.Convert(
        c.CType.WORD, helpers.limited(c.Convert(c.CType.SUM, raw), port.low, port.high)
    )

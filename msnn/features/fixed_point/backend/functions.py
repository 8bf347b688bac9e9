"""Writes the functions `init`, `reset` and `step` in fixed point."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from backends.c.interface.structs import step_text
from backends.c_language import tree as c
from backends.c_language.places import Index
from backends.c_language.scope import BlockScope, LocalNames
from msnn.features.fixed_point.backend.helpers import FixedHelpers
from msnn.features.fixed_point.backend.integer_nodes import IntegerLeafSource, IntegerNodes
from msnn.features.fixed_point.backend.memories import (
    MemoryWriter,
    check_input,
    check_window,
    element,
    word_of,
)
from msnn.features.fixed_point.backend.structs import FixedNames
from msnn.features.fixed_point.integers.interpret import FixedStatus, initial
from msnn.features.fixed_point.integers.program import (
    ExpectedWords,
    IntegerMemory,
    IntegerProgram,
    ReadMemory,
)

_FILLS, _WAITS, _INITIALISED = 1, 2, 4
"""Bits of the field `ready`: buffers wait for their first sample, states wait for `reset`, and the
struct was initialised."""


class FixedFunctions:
    """Writes the functions `init`, `reset` and `step` of one program, and the helpers that they
    share.
    """

    def __init__(self, program: IntegerProgram, names: FixedNames) -> None:
        self._program, self._names = program, names
        self._helpers = FixedHelpers(names.prefix)
        self._fills = [m for m in program.memories if m.first_fills is not None]
        self._waits = any(m.from_record and m.first_fills is None for m in program.memories)

    def all(self) -> dict[str, c.Function]:
        """The functions `init`, `reset` and `step` by name.

        Call this before `definitions`, which lists the helpers that they call.
        """
        return {"init": self._init(), "reset": self._reset(), "step": self._step()}

    def definitions(self) -> tuple[c.Function, ...]:
        """The helper functions that `init`, `reset` and `step` call."""
        return self._helpers.definitions()

    def status_bits(self) -> list[FixedStatus]:
        """The status bits that a step of this program can return, in ascending order."""
        bits = FixedStatus(0)
        for entry in self._program.inputs:
            bits |= _POLICY_BITS.get(entry.policy, FixedStatus.CLAMPED)
        for memory in self._program.memories:
            # bounds are proved for every node: where those of the next value lie within the memory,
            # no word can saturate, and the header does not promise the bit
            ends = [self._program.step[node] for node in memory.next]
            ends += [self._program.start[node] for node in memory.start]
            if any(end.low < memory.low or end.high > memory.high for end in ends):
                bits |= FixedStatus.STATE_SATURATED
        if self._program.expected:
            bits |= FixedStatus.EQUATION_OUT_OF_RANGE
        if self._program.windows:
            bits |= FixedStatus.CLAMPED
        return list(bits | FixedStatus.UNINITIALISED if self._has_state else bits)

    @property
    def _has_state(self) -> bool:
        return bool(self._program.memories or self._names.held)

    def _init(self) -> c.Function:
        scope, state = self._scope(), initial(self._program)
        for memory in self._program.memories:
            self._memories(scope).set(memory, state.memories[memory.name])
        self._set_held(scope, state.held)
        # sums of distinct bits, so that the constant in C is one literal
        ready = _INITIALISED + (_FILLS if self._fills else 0) + (_WAITS if self._waits else 0)
        scope.assign(self._ready, c.Unsigned(ready))
        doc = "Initialises the state without history."
        return self._function("init", "void", (), scope, doc)

    def _reset(self) -> c.Function:
        scope, program = self._scope(), self._program
        ports = {port.name: port for port in program.windows}
        if not ports:
            # the signature is the same for all models, used or not
            scope.add(c.Discard("x0"))
        scope.add(c.Declare(c.CType.STATUS, "status", c.Name(f"{self._names.macro}_OK")))
        clamped = self._bits(FixedStatus.CLAMPED)
        for port in program.windows:
            check_window(port, self._names.windows[port.name], clamped, self._helpers, scope)
        nodes = IntegerNodes(
            program.start,
            program.width,
            IntegerLeafSource(
                lambda name, at: word_of(ports[name], self._names.windows[name], at),
                self._no_memory,
            ),
            self._helpers,
            scope,
        )
        nodes.write()
        for memory in program.memories:
            self._memories(scope).start(memory, nodes, self._bits(FixedStatus.STATE_SATURATED))
        self._set_held(scope, initial(program).held)
        # every memory has its start: nothing waits any more
        scope.assign(self._ready, c.Unsigned(_INITIALISED))
        scope.add(c.Return(c.Name("status")))
        prefix = self._names.prefix
        arguments = (c.Argument(f"const {prefix}_init_t *", "x0"),)
        doc = "Initialises the state from a known past; returns what was out of order."
        return self._function("reset", f"{prefix}_status_t", arguments, scope, doc)

    def _step(self) -> c.Function:
        program, names, scope = self._program, self._names, self._scope()
        ports = {entry.port.name: entry.port for entry in program.inputs}
        if not ports:
            scope.add(c.Discard("u"))
        if not program.outputs:
            scope.add(c.Discard("y"))
        if not program.memories and not names.held:
            scope.add(c.Discard("s"))
        # the declaration comes before all statements: MISRA has it so, and every check below may
        # set a bit
        scope.add(c.Declare(c.CType.STATUS, "status", c.Name(f"{names.macro}_OK")))
        for entry in program.inputs:
            bits = _POLICY_BITS.get(entry.policy, FixedStatus.CLAMPED)
            check_input(entry, names, self._bits(bits), self._helpers, scope)
        self._first_step(scope)
        memories = self._memories(scope)
        nodes = IntegerNodes(
            program.step,
            program.width,
            IntegerLeafSource(
                lambda name, at: word_of(ports[name], names.inputs[name], at),
                lambda name, at: memories.element(self._named(name), at),
                frozenset(memory.name for memory in program.memories if memory.wide),
                self._loaded(),
            ),
            self._helpers,
            scope,
        )
        nodes.write()
        for port, results in program.outputs:
            for index, node in enumerate(results):
                field = c.Member("y", names.outputs[port.name])
                scope.assign(element(field, port.axes, Index(index)), nodes.as_word(node))
        for entry in program.expected:
            self._expected(entry, nodes, scope)
        saturated = self._bits(FixedStatus.STATE_SATURATED)
        # last: reads that are written where they are used would see the next state
        for memory in program.memories:
            restart = initial(program).memories[memory.name] if memory.restarts else None
            memories.commit(memory, nodes, saturated, restart)
        scope.add(c.Return(c.Name("status")))
        prefix = names.prefix
        arguments = (
            c.Argument(f"const {prefix}_in_t *", "u"),
            c.Argument(f"{prefix}_out_t *", "y"),
        )
        doc = step_text(self._program.late)
        return self._function("step", f"{prefix}_status_t", arguments, scope, doc)

    def _first_step(self, scope: BlockScope) -> None:
        """Writes the code of a step before the memories are complete: it reports a missing `init`
        or `reset`, and fills buffers that `init` could not fill with copies of the first sample.
        """
        statements: list[c.Statement] = []
        if self._has_state:
            # states wait for `reset`, or nobody has called `init`
            begun = c.Binary("&", self._ready, c.Unsigned(_WAITS | _INITIALISED))
            waits = c.Binary("!=", begun, c.Unsigned(_INITIALISED))
            statements.append(c.If(waits, (self._bits(FixedStatus.UNINITIALISED),)))
        if self._fills:
            inner = scope.inner()
            for memory in self._fills:
                assert memory.first_fills is not None, "only those are here"
                port, elements = memory.first_fills
                source = next(e.port for e in self._program.inputs if e.port.name == port)
                words = [
                    word_of(source, self._names.inputs[port], Index(element))
                    for element in elements
                ]
                self._memories(inner).fill(memory, words)
            filled = c.Unsigned(_WAITS | _INITIALISED)
            # the bit of filling goes out, the others stay
            inner.assign(self._ready, c.Binary("&", self._ready, filled))
            empty = c.Binary("!=", c.Binary("&", self._ready, c.Unsigned(_FILLS)), c.Unsigned(0))
            statements.append(c.If(empty, tuple(inner.statements)))
        if statements:
            # one comparison in every later step, however much there is to do in the first
            unready = c.Binary("!=", self._ready, c.Unsigned(_INITIALISED))
            scope.add(c.If(unready, tuple(statements)))

    def _expected(self, entry: ExpectedWords, nodes: IntegerNodes, scope: BlockScope) -> None:
        """Writes the checks of an equation's range in `step`. A value outside sets a status bit; it
        was limited before.
        """
        scope.note(f"expected of {entry.name}")
        report = self._bits(FixedStatus.EQUATION_OUT_OF_RANGE)
        for node, low, high in zip(entry.nodes, entry.low, entry.high, strict=True):
            value = nodes.value(node)
            below, above = (
                c.Binary("<", value, c.Integer(low)),
                c.Binary(">", value, c.Integer(high)),
            )
            scope.add(c.If(c.Binary("||", below, above), (report,)))

    def _loaded(self) -> frozenset[int]:
        """The nodes that read an element of a memory which is needed after that memory was
        overwritten.

        They are read into local variables first. A buffer that shifts by samples in place needs
        none.
        """
        found: set[int] = set()
        for memory in self._program.memories:
            for index, node in enumerate(memory.next):
                op = self._program.step[node].op
                in_place = isinstance(op, ReadMemory) and op.memory == memory.name
                # a loop upwards reads a later element before it is overwritten
                if isinstance(op, ReadMemory) and not (in_place and op.index > index):
                    found.add(node)
        for _, nodes in self._program.outputs:
            found.update(n for n in nodes if isinstance(self._program.step[n].op, ReadMemory))
        return frozenset(found)

    def _set_held(self, scope: BlockScope, values: Mapping[str, Sequence[int]]) -> None:
        for name, words in values.items():
            port = next(e.port for e in self._program.inputs if e.port.name == name)
            for index, word in enumerate(words):
                field = c.Member("s", self._names.held[name])
                value = c.Convert(c.CType.WORD, c.Integer(word))
                scope.assign(element(field, port.axes, Index(index)), value)

    def _memories(self, scope: BlockScope) -> MemoryWriter:
        return MemoryWriter(self._program, self._names, self._helpers, scope)

    def _named(self, name: str) -> IntegerMemory:
        return next(memory for memory in self._program.memories if memory.name == name)

    def _no_memory(self, name: str, at: Index) -> c.Expression:
        raise AssertionError("the start reads the record alone")

    def _bits(self, bits: FixedStatus) -> c.Statement:
        first, *others = (c.Name(self._names.status(bit)) for bit in bits)
        value: c.Expression = first
        for bit in others:
            value = c.Binary("|", value, bit)
        return c.SetBits(c.Name("status"), value)

    @property
    def _ready(self) -> c.Member:
        return c.Member("s", self._names.ready)

    def _scope(self) -> BlockScope:
        return BlockScope(LocalNames(self._names.prefix))

    def _function(
        self, name: str, result: str, structs: tuple[c.Argument, ...], scope: BlockScope, doc: str
    ) -> c.Function:
        prefix = self._names.prefix
        arguments = (c.Argument(f"{prefix}_state_t *", "s"), *structs)
        return c.Function(
            name=f"{prefix}_{name}",
            result=result,
            arguments=arguments,
            body=tuple(scope.statements),
            doc=doc,
        )


_POLICY_BITS = {
    "hold": FixedStatus.HELD,
    "flag": FixedStatus.OUT_OF_RANGE | FixedStatus.CLAMPED,
}
"""The status bits that an invalid input sets, by policy; all other policies set CLAMPED."""

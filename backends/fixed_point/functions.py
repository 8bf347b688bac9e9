"""The bodies of `init`, `reset` and `step` in fixed point."""

from __future__ import annotations

from collections.abc import Iterator

from backends.c.c_layout import wrapped
from backends.fixed_point.names import FixedNames
from backends.fixed_point.statements import Statements, literal
from compiler.fixed_point.integer_program import (
    CheckedInput,
    ExpectedWords,
    IntegerProgram,
    Memory,
    ReadMemory,
    WordPort,
)
from compiler.fixed_point.run_integers import initial

_INDENT = "    "


class FixedFunctions:
    """Text of the functions of one program, with the tables that they share."""

    def __init__(self, program: IntegerProgram, names: FixedNames) -> None:
        self.program, self.names = program, names
        self.tables: dict[tuple[int, ...], str] = {}
        self.fills = [m for m in program.memories if m.first_fills is not None]
        self.waits = any(m.from_record and m.first_fills is None for m in program.memories)

    def init(self) -> str:
        state = initial(self.program)
        lines: list[str] = []
        for memory in self.program.memories:
            lines += self._constants(memory.name, self.names.memories, state.memories[memory.name])
        lines += self._held(state.held)
        lines.append(f"s->{self.names.waiting} = {1 * bool(self.fills) + 2 * self.waits}U;")
        return _body(lines)

    def reset(self) -> str:
        ports = {port.name: port for port in self.program.windows}
        lines = [
            line
            for port in ports.values()
            for line in self._checked_words(port, self.names.windows[port.name], "x0")
        ]
        statements = Statements(
            self.program.width,
            self.names.prefix,
            self.program.start,
            lambda port, index: _element(f"w_{self.names.windows[port]}", ports[port], index),
            lambda memory, index: "",
            self.tables,
        )
        lines += statements.lines()
        for memory in self.program.memories:
            for index, node in enumerate(memory.start):
                found = self.program.start[node]
                stored = self._stored(statements, node, memory, (found.low, found.high))
                lines.append(f"{self._memory(memory, index)} = {stored};")
        lines += self._held(initial(self.program).held)
        lines.append(f"s->{self.names.waiting} = 0U;")
        if not ports:
            lines.append("(void)x0;")
        return _body(lines)

    def step(self) -> str:
        program, names = self.program, self.names
        ports = {entry.port.name: entry.port for entry in program.inputs}
        lines = [f"{names.prefix}_status_t status = {names.macro}_OK;"]
        for entry in program.inputs:
            lines += self._checked_input(entry)
        if not ports:
            lines.append("(void)u;")
        lines += self._first_fill()
        statements = Statements(
            program.width,
            names.prefix,
            program.step,
            lambda port, index: _element(f"w_{names.inputs[port]}", ports[port], index),
            lambda memory, index: self._memory(self._named(memory), index),
            self.tables,
            frozenset(memory.name for memory in program.memories if memory.wide),
            self._loaded(),
        )
        lines += statements.lines()
        for port, nodes in program.outputs:
            for index, node in enumerate(nodes):
                target = _element(f"y->{names.outputs[port.name]}", port, index)
                lines.append(f"{target} = {statements.as_word(node)};")
        for entry in program.expected:
            lines += self._expected(entry, statements)
        for memory in program.memories:
            lines += self._commit(memory, statements)
        if not program.memories and not names.held:
            lines.append("(void)s;")
        lines.append("return status;")
        return _body(lines)

    # ---- inputs

    def _checked_words(self, port: WordPort, field: str, base: str) -> Iterator[str]:
        """`w_field`: the words of a window, moved into their range."""
        prefix = self.names.prefix
        limits = f"{self._literal(port.low)}, {self._literal(port.high)}"
        if not port.axes:
            call = f"{prefix}_limited(({prefix}_sum_t){base}->{field}, {limits})"
            yield f"const {prefix}_word_t w_{field} = ({prefix}_word_t){call};"
            return
        yield f"{prefix}_word_t w_{field}[{port.size}];"
        yield f"for (uint32_t i = 0U; i < {port.size}U; i++) {{"
        call = f"{prefix}_limited(({prefix}_sum_t){base}->{field}[i], {limits})"
        yield f"{_INDENT}w_{field}[i] = ({prefix}_word_t){call};"
        yield "}"

    def _checked_input(self, entry: CheckedInput) -> Iterator[str]:
        names, port = self.names, entry.port
        field = names.inputs[port.name]
        index = "[i]" if port.axes else ""
        word, raw, held = f"w_{field}{index}", f"u->{field}{index}", names.held.get(port.name)
        inner: list[str] = []
        type, wide = f"{names.prefix}_word_t", f"{names.prefix}_sum_t"
        limits = f"{self._literal(port.low)}, {self._literal(port.high)}"
        call = f"({type}){names.prefix}_limited(({wide}){raw}, {limits})"
        if port.axes:
            inner.append(f"{word} = {call};")
        else:
            yield f"{type} {word} = {call};"
        bits = {
            "hold": f"{names.macro}_STATUS_HELD",
            "flag": f"{names.macro}_STATUS_OUT_OF_RANGE | {names.macro}_STATUS_CLAMPED",
        }.get(entry.policy, f"{names.macro}_STATUS_CLAMPED")
        inner.append(f"if ({word} != {raw}) {{")
        if held is not None:
            inner.append(f"{_INDENT}{word} = s->{held}{index};")
        inner += [f"{_INDENT}status |= {bits};", "}"]
        if held is not None:
            inner.append(f"s->{held}{index} = {word};")
        if port.axes:
            yield f"{type} {word.removesuffix('[i]')}[{port.size}];"
            yield f"for (uint32_t i = 0U; i < {port.size}U; i++) {{"
            yield from (f"{_INDENT}{line}" for line in inner)
            yield "}"
        else:
            yield from inner

    def _first_fill(self) -> Iterator[str]:
        """Buffers that `init` could not fill take the first sample for all samples."""
        names = self.names
        if self.waits or self.fills:
            yield f"if (s->{names.waiting} != 0U) {{"
            if self.waits:
                yield f"{_INDENT}if (s->{names.waiting} >= 2U) {{"
                yield f"{_INDENT * 2}status |= {names.macro}_STATUS_UNINITIALISED;"
                yield f"{_INDENT}}}"
            if self.fills:
                yield f"{_INDENT}if ((s->{names.waiting} & 1U) != 0U) {{"
                for memory in self.fills:
                    assert memory.first_fills is not None, "only those are here"
                    port, elements = memory.first_fills
                    source = next(e.port for e in self.program.inputs if e.port.name == port)
                    samples = memory.size // len(elements)
                    for row, element in enumerate(elements):
                        word = _element(f"w_{names.inputs[port]}", source, element)
                        begin, end = row * samples, (row + 1) * samples
                        yield f"{_INDENT * 2}for (uint32_t i = {begin}U; i < {end}U; i++) {{"
                        yield f"{_INDENT * 3}s->{names.memories[memory.name]}[i] = {word};"
                        yield f"{_INDENT * 2}}}"
                yield f"{_INDENT * 2}s->{names.waiting} &= 2U;"
                yield f"{_INDENT}}}"
            yield "}"

    def _expected(self, entry: ExpectedWords, statements: Statements) -> Iterator[str]:
        """Reports an equation that is outside its range; the step uses the end of the range."""
        yield f"/* expected of {entry.name} */"
        for node, low, high in zip(entry.nodes, entry.low, entry.high, strict=True):
            value = statements.value(node)
            below, above = f"{value} < {self._literal(low)}", f"{value} > {self._literal(high)}"
            yield f"if (({below}) || ({above})) {{"
            yield f"{_INDENT}status |= {self.names.macro}_STATUS_EQUATION_OUT_OF_RANGE;"
            yield "}"

    # ---- memories

    def _loaded(self) -> frozenset[int]:
        """Reads that the commits need, but for those that move a buffer by samples in place."""
        found: set[int] = set()
        for memory in self.program.memories:
            for index, node in enumerate(memory.next):
                op = self.program.step[node].op
                in_place = isinstance(op, ReadMemory) and op.memory == memory.name
                if isinstance(op, ReadMemory) and not (in_place and op.index > index):
                    found.add(node)
        for _, nodes in self.program.outputs:
            found.update(n for n in nodes if isinstance(self.program.step[n].op, ReadMemory))
        return frozenset(found)

    def _commit(self, memory: Memory, statements: Statements) -> Iterator[str]:
        for index, node in enumerate(memory.next):
            found = self.program.step[node]
            target = self._memory(memory, index)
            stored = self._stored(statements, node, memory, (found.low, found.high))
            yield f"{target} = {stored};"
            if found.low < memory.low or found.high > memory.high:
                yield f"if ({target} != {statements.value(node)}) {{"
                yield f"{_INDENT}status |= {self.names.macro}_STATUS_STATE_SATURATED;"
                yield "}"

    def _stored(
        self, statements: Statements, node: int, memory: Memory, bounds: tuple[int, int]
    ) -> str:
        """A node as a memory keeps it: within its limits, in its type."""
        if bounds[0] >= memory.low and bounds[1] <= memory.high:
            return statements.value(node) if memory.wide else statements.as_word(node)
        limits = f"{self._literal(memory.low)}, {self._literal(memory.high)}"
        limited = f"{self.names.prefix}_limited({statements.value(node)}, {limits})"
        return limited if memory.wide else f"({self.names.prefix}_word_t){limited}"

    def _memory(self, memory: Memory, index: int) -> str:
        field = f"s->{self.names.memories[memory.name]}"
        return f"{field}[{index}]" if memory.axes else field

    def _named(self, name: str) -> Memory:
        return next(memory for memory in self.program.memories if memory.name == name)

    def _constants(self, name: str, fields: dict[str, str], values: list[int]) -> Iterator[str]:
        field = f"s->{fields[name]}"
        is_array = bool(self._named(name).axes)
        if is_array and len(set(values)) == 1:
            yield f"for (uint32_t i = 0U; i < {len(values)}U; i++) {{"
            yield f"{_INDENT}{field}[i] = {self._initial(name, values[0])};"
            yield "}"
            return
        for index, value in enumerate(values):
            target = f"{field}[{index}]" if is_array else field
            yield f"{target} = {self._initial(name, value)};"

    def _initial(self, name: str, value: int) -> str:
        text = self._literal(value)
        return text if self._named(name).wide else f"({self.names.prefix}_word_t){text}"

    def _held(self, values: dict[str, list[int]]) -> Iterator[str]:
        for name, words in values.items():
            port = next(e.port for e in self.program.inputs if e.port.name == name)
            for index, word in enumerate(words):
                field = f"s->{self.names.held[name]}"
                target = f"{field}[{index}]" if port.axes else field
                yield f"{target} = ({self.names.prefix}_word_t){self._literal(word)};"

    def _literal(self, value: int) -> str:
        return literal(value, self.program.width)


def _element(name: str, port: WordPort, index: int) -> str:
    return f"{name}[{index}]" if port.axes else name


def _body(lines: list[str]) -> str:
    return "\n".join(part for line in lines for part in wrapped(f"{_INDENT}{line}"))

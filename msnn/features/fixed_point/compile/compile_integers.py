"""Makes the integer program of a model: formats of inputs, states and outputs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from numpy.typing import NDArray

from compiler.ir.nodes import extents, reads_log
from compiler.ir.ops import ReadLog, ReadSignal, Window
from compiler.ir.program import Expected, History, Node, Output, Program, Signal, State
from compiler.ir.types import WINDOW, Axis
from msnn.features.fixed_point import errors
from msnn.features.fixed_point.compile.constants import with_numbers
from msnn.features.fixed_point.compile.invariants import proved_bounds
from msnn.features.fixed_point.compile.lower_graph import (
    Elements,
    Lowering,
    UnsupportedError,
    elements,
)
from msnn.features.fixed_point.compile.word_formats import finite, word_format
from msnn.features.fixed_point.integers.builder import CannotFitError, IntegerBuilder
from msnn.features.fixed_point.integers.program import (
    CheckedInput,
    ExpectedWords,
    IntegerMemory,
    IntegerProgram,
    ReadWord,
    StepError,
    Width,
    WordPort,
    without_unused,
)
from spec_schema.diagnostics.diagnostic import SpecError

_MOST_NODES = 20_000
"""Maximum number of integer operations per step; more would fill the flash of any core without an
FPU."""


def integer_program(
    program: Program, weights: Mapping[str, NDArray[Any]], width: Width
) -> IntegerProgram:
    """Compiles a program to integers, with `weights` (physical values by name) as its constants.

    `program` is in step form. Losses are dropped. Raises SpecError for a value without bounds, an
    unsupported operation or a possible overflow.
    """
    program = with_numbers(program, weights)
    try:
        return _Compilation(program, width).result()
    except UnsupportedError as error:
        raise SpecError([errors.not_in_fixed_point(error.what, error.span, error.why)]) from None


class _Compilation:
    """The state of the compilation of one program. Creating it raises SpecError if an input or a
    recorded signal has no finite range.
    """

    def __init__(self, program: Program, width: Width) -> None:
        self.program, self.width = program, width
        self.ports: dict[str, WordPort] = {}
        self.windows: dict[str, tuple[WordPort, int]] = {}
        self.formats: dict[str, tuple[int, int, int]] = {}
        self.values: dict[tuple[int, str], Elements] = {}
        self._windows_read()
        faults = [
            errors.range_needed("input", signal.name, signal.span)
            for signal in self._signals_read()
            if finite(self._range(signal)) is None
        ]
        if faults:
            raise SpecError(faults)

    def result(self) -> IntegerProgram:
        program = self.program
        # the start comes first: how large a filter may become depends on where it begins
        first = Lowering(program.start, self.width, self._window_words, self._no_state)
        self._bound_states(first)
        step = Lowering(program.step, self.width, self._input_words, self._state_words)
        outputs = tuple(self._output(output, step) for output in program.outputs)
        memories = tuple(self._memory(state, step, first) for state in program.states)
        return without_unused(self._program(step, first, outputs, memories))

    def _program(
        self,
        step: Lowering,
        first: Lowering,
        outputs: tuple[tuple[WordPort, tuple[int, ...]], ...],
        memories: tuple[IntegerMemory, ...],
    ) -> IntegerProgram:
        program = self.program
        if len(step.builder.nodes) > _MOST_NODES:
            why = f"{len(step.builder.nodes)} operations, more than {_MOST_NODES}"
            raise UnsupportedError("the step", None, f"needs {why}")
        read = [signal for signal in program.signals if signal.name in self.ports]
        return IntegerProgram(
            name=program.name,
            width=self.width,
            inputs=tuple(CheckedInput(self.ports[s.name], s.on_invalid) for s in read),
            windows=tuple(port for port, _ in self.windows.values()),
            window_firsts=tuple(first for _, first in self.windows.values()),
            outputs=outputs,
            memories=memories,
            step=tuple(step.builder.nodes),
            start=tuple(first.builder.nodes),
            expected=tuple(_expected_words(entry, step) for entry in program.expected),
            step_errors=tuple(step_errors(program, step.builder, outputs, memories)),
            start_errors=tuple(start_errors(first.builder, memories)),
            doc=program.doc,
            spec_hash=program.spec_hash,
            made_by=program.made_by,
            sample_time=program.sample_time,
            late=program.late,
        )

    # ---- what is read

    def _signals_read(self) -> list[Signal]:
        names = {n.op.signal for _, n in self.program.step if isinstance(n.op, ReadSignal)}
        names |= set(self.windows)
        return [signal for signal in self.program.signals if signal.name in names]

    def _range(self, signal: Signal) -> tuple[float, float] | None:
        """The range of a signal in the spec; a recorded state without its own range has that of the
        state. None without either.
        """
        states = {state.name: state.range for state in self.program.states}
        return signal.range or states.get(signal.name)

    def _windows_read(self) -> None:
        read = extents(self.program.start, log=True)
        for signal in self.program.signals:
            if signal.name in read and finite(self._range(signal)) is not None:
                extent = read[signal.name]
                axes = (*signal.axes, Axis(WINDOW, extent.last - extent.first + 1))
                self.windows[signal.name] = self._port(signal, axes), extent.first
            elif signal.name in read:
                raise SpecError([errors.range_needed("signal", signal.name, signal.span)])

    def _port(self, signal: Signal, axes: tuple[Axis, ...]) -> WordPort:
        low, high = self._range(signal) or (0.0, 0.0)
        fraction, least, most = word_format(low, high, self.width.word)
        doc, span = signal.doc, signal.span
        return WordPort(
            name=signal.name,
            axes=axes,
            unit=signal.unit,
            fraction=fraction,
            low=least,
            high=most,
            doc=doc,
            span=span,
        )

    def _input_words(self, lowering: Lowering, node: Node) -> Elements:
        assert isinstance(node.op, ReadSignal), "a step in step form reads ports only"
        signal = self.program.signal(node.op.signal)
        port = self.ports.setdefault(signal.name, self._port(signal, node.type.axes))
        nodes = [
            lowering.builder.word(port.name, index, port.fraction, port.low, port.high)
            for index in range(port.size)
        ]
        return elements(lowering, nodes, node.type.shape)

    def _window_words(self, lowering: Lowering, node: Node) -> Elements:
        assert isinstance(node.op, ReadLog), "a start reads the record"
        port, first = self.windows[node.op.signal]
        samples = port.axes[-1].size
        rows = port.size // samples
        # the port has every sample that some node reads; this node reads a part of them
        begin, end = node.op.first - first, node.op.last - first + 1
        nodes = [
            lowering.builder.word(
                port.name, row * samples + sample, port.fraction, port.low, port.high
            )
            for row in range(rows)
            for sample in range(begin, end)
        ]
        return elements(lowering, nodes, node.type.shape)

    # ---- states

    @staticmethod
    def _no_state(lowering: Lowering, name: str) -> Elements:
        raise AssertionError("a start reads no state")

    def _bound_states(self, starts: Lowering) -> None:
        """Chooses the formats of all states except buffers of equations, from their ranges in the
        spec or from proved bounds. `starts` is the lowered start of the program.

        A buffer of an equation has the format of the equation's value.
        """
        unknown: list[State] = []
        for state in self.program.states:
            limits = finite(state.range)
            if limits is not None:
                bits = self.width.word if self._is_word(state) else self.width.sum - 2
                self.formats[state.name] = word_format(*limits, bits)
            elif not state.is_buffer:
                unknown.append(state)
        if not unknown:
            return
        first = {
            state.name: max(
                abs(end) for n in starts.nodes(state.start) for end in starts.builder.bounds(n)
            )
            for state in unknown
        }
        bounds = proved_bounds(
            unknown, self.program, self.width, self._input_words, self._state_words, first
        )
        for state in unknown:
            bits = self.width.word if self._is_word(state) else self.width.sum - 2
            reach = bounds[state.name]
            self.formats[state.name] = word_format(-reach, reach, bits)

    def _is_word(self, state: State) -> bool:
        """True if the state is stored as words. Other 16-bit states keep all bits of a sum."""
        return self.width.word >= 32 or state.is_buffer

    def _state_words(self, lowering: Lowering, name: str) -> Elements:
        key = id(lowering), name
        if key not in self.values:
            state = self.program.state(name)
            if name not in self.formats:
                self.formats[name] = self._kept_format(lowering, state)
            shape = tuple(axis.size for axis in state.axes)
            nodes = [
                lowering.builder.memory(name, index, *self.formats[name])
                for index in range(math.prod(shape))
            ]
            self.values[key] = elements(lowering, nodes, shape)
        return self.values[key]

    def _kept_format(self, lowering: Lowering, state: State) -> tuple[int, int, int]:
        """The format of a buffer of an equation, which is that of the equation's value: (fraction,
        low, high).
        """
        newest = next(
            node.args[0]
            for _, node in self.program.step
            if isinstance(node.op, Window) and node.op.state == state.name
        )
        bounds = [lowering.builder.bounds(node) for node in lowering.nodes(newest)]
        low, high = min(b for b, _ in bounds), max(b for _, b in bounds)
        return word_format(low, high, self.width.word)

    def _memory(self, state: State, step: Lowering, start: Lowering) -> IntegerMemory:
        following = step.nodes(state.next)
        if state.name not in self.formats:
            self._state_words(step, state.name)
        fraction, low, high = self.formats[state.name]
        try:
            after = tuple(step.builder.to_fraction(node, fraction) for node in following)
            begin = start.nodes(state.start)
            before = tuple(start.builder.to_fraction(node, fraction) for node in begin)
        except CannotFitError as error:
            raise UnsupportedError(f"state `{state.name}`", state.span, str(error)) from None
        return IntegerMemory(
            name=state.name,
            axes=state.axes,
            unit=state.unit,
            fraction=fraction,
            low=low,
            high=high,
            wide=not self._is_word(state),
            next=after,
            start=before,
            from_record=reads_log(self.program.start, state.start),
            first_fills=self._filling(state, step),
            doc=state.doc,
            span=state.span,
            restarts=state.on_range == "reset",
        )

    def _filling(self, state: State, step: Lowering) -> tuple[str, tuple[int, ...]] | None:
        """The port and elements whose words fill a buffer of an input; None for other memories."""
        if not isinstance(state.origin, History) or not state.is_buffer:
            return None
        samples = state.axes[-1].size
        # the newest sample is the last of each row
        newest = [step.builder[node].op for node in step.nodes(state.next)[samples - 1 :: samples]]
        words = [op for op in newest if isinstance(op, ReadWord)]
        if len(words) < len(newest):
            return None
        return words[0].port, tuple(word.index for word in words)

    def _output(self, output: Output, step: Lowering) -> tuple[WordPort, tuple[int, ...]]:
        nodes = [step.builder.as_word(node) for node in step.nodes(output.node)]
        # one scale for the whole array: the coarsest one, which no element overflows
        fraction = min(step.builder[node].fraction for node in nodes)
        nodes = [step.builder.to_fraction(node, fraction) for node in nodes]
        found = [step.builder[node] for node in nodes]
        type = self.program.step[output.node].type
        low, high = min(n.low for n in found), max(n.high for n in found)
        port = WordPort(
            name=output.name,
            axes=type.axes,
            unit=type.unit,
            fraction=fraction,
            low=low,
            high=high,
            doc=output.doc,
            span=output.span,
        )
        return port, tuple(nodes)


def _expected_words(entry: Expected, step: Lowering) -> ExpectedWords:
    """The checks of an equation's range: the elements whose proved bounds exceed it, with integer
    limits that are rounded outwards.
    """
    low, high = entry.range
    found = [(node, step.builder[node]) for node in step.nodes(entry.node)]
    # limits are rounded outwards, so that a value on the limit is within it at any scale
    limits = {
        node: (math.floor(math.ldexp(low, n.fraction)), math.ceil(math.ldexp(high, n.fraction)))
        for node, n in found
    }
    # proved bounds within the limits need no check in the step
    outside = [i for i, n in found if n.low < limits[i][0] or n.high > limits[i][1]]
    return ExpectedWords(
        name=entry.name,
        nodes=tuple(outside),
        low=tuple(limits[node][0] for node in outside),
        high=tuple(limits[node][1] for node in outside),
    )


def step_errors(
    program: Program,
    builder: IntegerBuilder,
    outputs: Sequence[tuple[WordPort, tuple[int, ...]]],
    memories: Sequence[IntegerMemory],
) -> Iterator[StepError]:
    """Yields the proved error of each output and state after one step: that of its worst element,
    from the errors of the nodes; inf if nothing is proved.
    """
    for port, nodes in outputs:
        worst = max(builder.errors[node] for node in nodes)
        yield StepError(port.name, is_state=False, largest=worst)
    for memory in memories:
        state = program.state(memory.name)
        error = max(builder.errors[node] for node in memory.next)
        if memory.restarts and _may_leave(builder, memory, error):
            error = math.inf  # one of the two may start anew
        limits = None if state.is_buffer else finite(state.range)
        if limits is not None:  # both are kept within their limits, which are rounded
            ends = zip(limits, (memory.low, memory.high), strict=True)
            error = max(error, *(abs(a - math.ldexp(b, -memory.fraction)) for a, b in ends))
        yield StepError(memory.name, is_state=True, largest=error)


def start_errors(builder: IntegerBuilder, memories: Sequence[IntegerMemory]) -> Iterator[StepError]:
    """Yields the proved error of each first state: that of its worst element."""
    for memory in memories:
        worst = max(builder.errors[node] for node in memory.start)
        yield StepError(memory.name, is_state=True, largest=worst)


def _may_leave(builder: IntegerBuilder, memory: IntegerMemory, error: float) -> bool:
    """True if the exact next value of a memory may be outside its range, given the error of the
    computed one.
    """
    following = [builder[node] for node in memory.next]
    room = min(min(n.low - memory.low, memory.high - n.high) for n in following)
    return math.ldexp(room, -memory.fraction) <= error

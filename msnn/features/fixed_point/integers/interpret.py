"""Runs an integer program: the reference interpreter of generated fixed-point C."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntFlag
from typing import assert_never

from msnn.features.fixed_point.integers import program as integer

Words = Mapping[str, Sequence[int]]
"""Integers by port name; each is a flat list in C order."""


class FixedStatus(IntFlag):
    """The status of a step; bits that floating-point exports also have mean the same."""

    OUT_OF_RANGE = 1
    CLAMPED = 4
    HELD = 8
    STATE_SATURATED = 16
    UNINITIALISED = 32
    EQUATION_OUT_OF_RANGE = 64


NOTHING = FixedStatus(0)
"""No status bit is set."""


@dataclass(slots=True, kw_only=True)
class IntegerState:
    """The state of one instance of a program: words of its memories, and the last valid words
    (`held`) of inputs with the policy `hold`.
    """

    memories: dict[str, list[int]]
    held: dict[str, list[int]]
    fills: bool = False
    """True if buffers of inputs wait for their first sample."""
    waits: bool = False
    """True if there are states that only `reset` can set."""
    said: FixedStatus = NOTHING
    """Status of `reset`: checks of the samples and of the first states."""


@dataclass(frozen=True, slots=True)
class IntegerStep:
    """The results of a step: words of the outputs by name, the status, and the values
    of all nodes.
    """

    outputs: dict[str, list[int]]
    status: FixedStatus
    nodes: list[int] = field(repr=False)


def initial(program: integer.IntegerProgram) -> IntegerState:
    """The state after `init`.

    States that need a recording are 0, or the nearest value in their range.
    """
    # without a record the start runs on zeros; what depends on them is not kept below
    zeros = {port.name: [0] * port.size for port in program.windows}
    values = evaluated(program.start, zeros, {})
    memories = {
        memory.name: [
            _within(0 if memory.from_record else values[node], memory.low, memory.high)
            for node in memory.start
        ]
        for memory in program.memories
    }
    fills = any(m.first_fills is not None for m in program.memories)
    waits = any(m.from_record and m.first_fills is None for m in program.memories)
    return IntegerState(memories=memories, held=_first_held(program), fills=fills, waits=waits)


def reset(program: integer.IntegerProgram, windows: Words) -> IntegerState:
    """The state that `reset` computes from `windows`, the words around the first step. Words and
    states outside their ranges are limited, and `said` reports it.
    """
    checked = {
        port.name: [_within(word, port.low, port.high) for word in windows[port.name]]
        for port in program.windows
    }
    values = evaluated(program.start, checked, {})
    memories = {memory.name: _kept(memory, memory.start, values) for memory in program.memories}
    moved = any(checked[name] != list(windows[name]) for name in checked)
    said = FixedStatus.CLAMPED if moved else FixedStatus(0)
    # what does not fit the word or its range is cut, and the status says so
    if any(memories[m.name] != [values[node] for node in m.start] for m in program.memories):
        said |= FixedStatus.STATE_SATURATED
    return IntegerState(memories=memories, held=_first_held(program), said=said)


def step(program: integer.IntegerProgram, state: IntegerState, inputs: Words) -> IntegerStep:
    """Computes one step from the words of the inputs, and updates `state` in place."""
    status = FixedStatus(0)
    words: dict[str, list[int]] = {}
    for entry in program.inputs:
        name = entry.port.name
        words[name], bits = checked_input(entry, inputs[name], state.held.get(name, []))
        status |= bits
        if name in state.held:
            state.held[name] = words[name]
    if state.fills:
        # the past of an input is taken to have been its first sample
        for memory in program.memories:
            if memory.first_fills is not None:
                port, elements = memory.first_fills
                samples = memory.size // len(elements)
                state.memories[memory.name] = [
                    words[port][element] for element in elements for _ in range(samples)
                ]
        state.fills = False
    # in every step until `reset`: steps alone never set these states
    if state.waits:
        status |= FixedStatus.UNINITIALISED
    values = evaluated(program.step, words, state.memories)
    for entry in program.expected:
        ends = zip(entry.nodes, entry.low, entry.high, strict=True)
        if not all(low <= values[node] <= high for node, low, high in ends):
            status |= FixedStatus.EQUATION_OUT_OF_RANGE
    following: dict[str, list[int]] = {}
    for memory in program.memories:
        following[memory.name] = _kept(memory, memory.next, values)
        if following[memory.name] != [values[n] for n in memory.next]:
            status |= FixedStatus.STATE_SATURATED
            # `on_range: reset`: a state that leaves its range begins again
            if memory.restarts:
                following[memory.name] = initial(program).memories[memory.name]
    # all at once: a state that reads another one reads its value before the step (R4)
    state.memories = following
    outputs = {port.name: [values[n] for n in nodes] for port, nodes in program.outputs}
    return IntegerStep(outputs, status, values)


def checked_input(
    entry: integer.CheckedInput, words: Sequence[int], held: Sequence[int]
) -> tuple[list[int], FixedStatus]:
    """The words that the step uses, always within the range, and the status bits of the check.
    `words` are the given ones, `held` the last valid ones.
    """
    low, high = entry.port.low, entry.port.high
    clamped = [_within(word, low, high) for word in words]
    if clamped == list(words):
        return clamped, FixedStatus(0)
    match entry.policy:
        case "hold":
            # element by element: those within the range are used as they came
            used = [w if c == w else h for w, c, h in zip(words, clamped, held, strict=True)]
            return used, FixedStatus.HELD
        case "flag":
            return clamped, FixedStatus.OUT_OF_RANGE | FixedStatus.CLAMPED
        # also `trust`: the proved bounds hold for words within the range alone
        case _:
            return clamped, FixedStatus.CLAMPED


def evaluated(
    nodes: Sequence[integer.IntegerNode], words: Words, memories: Mapping[str, Sequence[int]]
) -> list[int]:
    """The value of every node from the words of ports and memories; asserts that each is within its
    proved bounds.
    """
    values: list[int] = []
    for node in nodes:
        value = _value(node, [values[arg] for arg in node.args], words, memories)
        # the proof is run along: a bound that does not hold is a fault of ours, found by any test
        assert node.low <= value <= node.high, f"{node} is {value}"
        values.append(value)
    return values


def _value(
    node: integer.IntegerNode, args: list[int], words: Words, memories: Mapping[str, Sequence[int]]
) -> int:
    match node.op:
        case integer.Literal(value):
            return value
        case integer.ReadWord(port, index):
            return words[port][index]
        case integer.ReadMemory(memory, index):
            return memories[memory][index]
        case integer.WeightedSum(constant, coefficients):
            return constant + sum(c * a for c, a in zip(coefficients, args, strict=True))
        case integer.Product():
            return args[0] * args[1]
        case integer.RoundShift(bits):
            # half up, also below 0: Python's >> rounds down like the arithmetic shift of C targets
            return (args[0] + (1 << (bits - 1))) >> bits
        case integer.Smaller():
            return min(args)
        case integer.Larger():
            return max(args)
        case integer.Choose(relation):
            return args[2] if relation.holds(args[0], args[1]) else args[3]
        case integer.IntegerLookup(first, bits, table):
            place = args[0] - first
            # cells are powers of two wide: the upper bits are the cell, the lower ones the place in
            # it
            cell, part = place >> bits, place & ((1 << bits) - 1)
            # between the two entries along a straight line, rounded half up
            rise = (table[cell + 1] - table[cell]) * part
            half = (1 << bits) >> 1
            return table[cell] + ((rise + half) >> bits)
        case _:
            assert_never(node.op)


def _first_held(program: integer.IntegerProgram) -> dict[str, list[int]]:
    """The valid value nearest to 0, for inputs with the policy `hold`."""
    return {
        entry.port.name: [_within(0, entry.port.low, entry.port.high)] * entry.port.size
        for entry in program.inputs
        if entry.policy == "hold"
    }


def _kept(memory: integer.IntegerMemory, nodes: Sequence[int], values: Sequence[int]) -> list[int]:
    """The values of these nodes, limited to the range of a memory."""
    return [_within(values[node], memory.low, memory.high) for node in nodes]


def _within(value: int, low: int, high: int) -> int:
    return min(max(value, low), high)

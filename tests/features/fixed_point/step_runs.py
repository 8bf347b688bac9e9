"""Compares every step of many closed runs in words with the same step in float64, side by side."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compiler.ir.ops import Relation
from compiler.ir.program import Program
from msnn.features.fixed_point.deviation import HELD, ExactStepper
from msnn.features.fixed_point.golden.golden import drawn
from msnn.features.fixed_point.integers.interpret import initial, reset
from msnn.features.fixed_point.integers.program import (
    Choose,
    IntegerLookup,
    IntegerNode,
    IntegerProgram,
    Larger,
    Literal,
    Product,
    ReadMemory,
    ReadWord,
    RoundShift,
    Smaller,
    WeightedSum,
)

Words = NDArray[np.int64]
Reals = NDArray[np.float64]

_HOLDS = {
    Relation.LESS: np.less,
    Relation.LESS_EQUAL: np.less_equal,
    Relation.GREATER: np.greater,
    Relation.GREATER_EQUAL: np.greater_equal,
}


def step_errors(
    program: Program, weights: Mapping[str, Any], integers: IntegerProgram, runs: int, steps: int
) -> dict[tuple[str, bool], float]:
    """The largest error that a step adds to each output and state, over runs · steps steps.

    Before each the states in float64 are set to those in words, so that no error is handed on.
    """
    random = np.random.Generator(np.random.Philox(31))
    stepper = ExactStepper(program, weights)
    ports = {entry.port.name: entry.port for entry in integers.inputs}
    memories = _begun(integers, runs, random)
    words: dict[str, Words] = {}
    found: dict[tuple[str, bool], float] = {}
    for k in range(steps):
        fresh = {
            e.port.name: np.array([drawn(e.port, random) for _ in range(runs)], np.int64).T
            for e in integers.inputs
        }
        if words:  # every second run keeps its inputs for a while
            keeps = (np.arange(runs) % 2 == 1) & (k % HELD != 0)
            fresh = {n: np.where(keeps, words[n], new) for n, new in fresh.items()}
        words = fresh
        states = {
            m.name: _real(memories[m.name], m.fraction, tuple(a.size for a in m.axes))
            for m in integers.memories
        }
        given = {
            name: _real(words[name], port.fraction, tuple(a.size for a in port.axes))
            for name, port in ports.items()
        }
        exact = stepper.steps(given, states, runs)
        values = _evaluated(integers.step, words, memories)
        for port, nodes in integers.outputs:
            mine = np.stack([values[node] for node in nodes])
            _worst(found, (port.name, False), mine, port.fraction, exact.outputs[port.name])
        for m in integers.memories:
            following = np.stack([values[node] for node in m.next])
            kept = np.clip(following, m.low, m.high)
            if m.restarts:
                begin = np.array(initial(integers).memories[m.name])[:, None]
                kept = np.where((kept != following).any(axis=0), begin, kept)
            memories[m.name] = kept
            _worst(found, (m.name, True), kept, m.fraction, exact.next_states[m.name])
    return found


def _begun(integers: IntegerProgram, runs: int, random: np.random.Generator) -> dict[str, Words]:
    states = [
        reset(integers, {port.name: drawn(port, random) for port in integers.windows}).memories
        for _ in range(runs)
    ]
    return {
        m.name: np.array([state[m.name] for state in states], np.int64).T for m in integers.memories
    }


def _real(words: Words, fraction: int, shape: tuple[int, ...]) -> Reals:
    return np.ldexp(words.T.astype(np.float64), -fraction).reshape(-1, *shape)


def _worst(
    found: dict[tuple[str, bool], float],
    key: tuple[str, bool],
    words: Words,
    fraction: int,
    exact: Reals,
) -> None:
    mine = _real(words, fraction, exact.shape[1:])
    off = float(np.abs(mine - exact).max(initial=0.0))
    found[key] = max(found.get(key, 0.0), off)


def _evaluated(
    nodes: tuple[IntegerNode, ...], words: Mapping[str, Words], memories: Mapping[str, Words]
) -> list[Words]:
    values: list[Words] = []
    count = next(iter((*words.values(), *memories.values()))).shape[1]
    for node in nodes:
        args = [values[arg] for arg in node.args]
        values.append(_value(node, args, words, memories, count))
    return values


def _value(
    node: IntegerNode,
    args: list[Words],
    words: Mapping[str, Words],
    memories: Mapping[str, Words],
    count: int,
) -> Words:
    match node.op:
        case Literal(value):
            return np.full(count, value, np.int64)
        case ReadWord(port, index):
            return words[port][index]
        case ReadMemory(memory, index):
            return memories[memory][index]
        case WeightedSum(constant, coefficients):
            total = np.full(count, constant, np.int64)
            for coefficient, arg in zip(coefficients, args, strict=True):
                total += coefficient * arg
            return total
        case Product():
            return args[0] * args[1]
        case RoundShift(bits):
            return (args[0] + (1 << (bits - 1))) >> bits
        case Smaller():
            return np.minimum(*args)
        case Larger():
            return np.maximum(*args)
        case Choose(relation):
            return np.where(_HOLDS[relation](args[0], args[1]), args[2], args[3])
        case IntegerLookup(first, bits, entries):
            table = np.array(entries, np.int64)
            place = args[0] - first
            cell, part = place >> bits, place & ((1 << bits) - 1)
            rise = (table[cell + 1] - table[cell]) * part
            return table[cell] + ((rise + ((1 << bits) >> 1)) >> bits)

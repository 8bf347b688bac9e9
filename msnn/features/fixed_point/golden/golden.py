"""Draws the words of golden steps, and computes the results with the integer interpreter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msnn.features.fixed_point.integers.interpret import Words, initial, reset, step
from msnn.features.fixed_point.integers.program import IntegerProgram, WordPort

_OFTEN, _LONGEST = 0.15, 3
"""Probability that an input becomes invalid in a step, and maximum number of invalid steps."""
_SPECIAL = 0.2
"""Probability that a word is 0 or a limit of its range; random words rarely are."""


@dataclass(frozen=True, slots=True)
class IntegerGoldenStart:
    """The integers of the windows around the first step, by port, and the status of `reset`."""

    windows: dict[str, list[int]]
    status: int


@dataclass(frozen=True, slots=True)
class GoldenWords:
    """A golden run in words, flat lists by port: its start, then inputs, outputs and status of each
    step.
    """

    start: IntegerGoldenStart
    inputs: list[dict[str, list[int]]]
    outputs: list[dict[str, list[int]]]
    status: list[int]


def golden_run(
    program: IntegerProgram,
    steps: int,
    seed: int,
    *,
    from_init: bool = False,
    opening: int = 0,
    spoiled: int | None = None,
) -> GoldenWords:
    """A golden run of `steps` steps with random words, some of them invalid.

    It begins with a random past or, with `from_init`, without one. In the first `opening` steps
    every input has an invalid word. Every second word of the past from index `spoiled` on is
    invalid; None leaves all valid. The generator is counter-based (Philox), so a seed gives the
    same words on every machine.
    """
    random = np.random.Generator(np.random.Philox(seed))
    windows = {port.name: drawn(port, random) for port in program.windows}
    if spoiled is not None:
        for port in program.windows:
            for element in range(spoiled, port.size, 2):
                windows[port.name][element] = _far(program, random)
    inputs: list[dict[str, list[int]]] = []
    # each input has steps of its own: one bit of the status tells of all of them
    invalid = {entry.port.name: opening for entry in program.inputs}
    for _ in range(steps):
        words = {entry.port.name: drawn(entry.port, random) for entry in program.inputs}
        for entry in program.inputs:
            name = entry.port.name
            if random.random() < _SPECIAL:
                special = (entry.port.low, entry.port.high, _within(0, entry.port))
                words[name][int(random.integers(entry.port.size))] = int(random.choice(special))
            if not invalid[name] and random.random() < _OFTEN:
                invalid[name] = int(random.integers(1, _LONGEST, endpoint=True))
            if invalid[name]:
                # the words beside it show that they are judged one by one
                element = int(random.integers(entry.port.size))
                words[name][element] = _invalid(entry.port, program, random)
                invalid[name] -= 1
        inputs.append(words)
    return answered(program, windows, inputs, from_init=from_init)


def answered(
    program: IntegerProgram,
    windows: dict[str, list[int]],
    inputs: list[dict[str, list[int]]],
    *,
    from_init: bool = False,
) -> GoldenWords:
    """The golden run with these inputs, one mapping per step, from `windows` around the first step
    or, with `from_init`, from `init`.
    """
    state = reset(program, windows)
    start = IntegerGoldenStart(windows, int(state.said))
    if from_init:
        state = initial(program)
    answers = [step(program, state, words) for words in inputs]
    return GoldenWords(
        start,
        inputs,
        [answer.outputs for answer in answers],
        [int(answer.status) for answer in answers],
    )


def golden_starts(program: IntegerProgram, seed: int) -> list[IntegerGoldenStart]:
    """Starts that test each range check of `reset` by its status.

    The words are all at the lower limits, all at the upper limits, or random with one word just
    outside.
    """
    random = np.random.Generator(np.random.Philox(seed))
    ports = program.windows
    tried = [{port.name: [port.low] * port.size for port in ports}]
    tried.append({port.name: [port.high] * port.size for port in ports})
    for port in ports:
        for value in (port.low - 1, port.high + 1):
            if abs(value) <= program.width.largest_word:
                for element in sorted({0, port.size // 2, port.size - 1}):
                    words = {other.name: drawn(other, random) for other in ports}
                    words[port.name][element] = value
                    tried.append(words)
    return [IntegerGoldenStart(words, int(reset(program, words).said)) for words in tried]


def _invalid(port: WordPort, program: IntegerProgram, random: np.random.Generator) -> int:
    """A word just outside the range, or the largest or smallest word."""
    most = program.width.largest_word
    beside = [word for word in (port.low - 1, port.high + 1) if abs(word) <= most]
    return int(random.choice([*beside, _far(program, random)]))


def _far(program: IntegerProgram, random: np.random.Generator) -> int:
    most = program.width.largest_word
    return int(random.choice([-most, most]))


def _within(word: int, port: WordPort) -> int:
    return min(max(word, port.low), port.high)


def drawn(port: WordPort, random: np.random.Generator) -> list[int]:
    """Random words from the whole range of a port, one per element, as a flat list."""
    words = random.integers(port.low, port.high, port.size, endpoint=True)
    return [int(word) for word in words]


def flat(run_part: Words) -> list[int]:
    """The integers of all ports in one list, in the order of the mapping."""
    return [word for values in run_part.values() for word in values]

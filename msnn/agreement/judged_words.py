"""Runs the integer interpreter, the judge of C in fixed point, along a judge's free run."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.fixed_point.write_fixed_c import WIDTHS
from compiler.fixed_point.compile_integers import integer_program
from compiler.fixed_point.exact_steps import LOST, ExactStepper
from compiler.fixed_point.integers.interpret import reset, step
from compiler.fixed_point.integers.program import (
    IntegerMemory,
    IntegerProgram,
    StepError,
    WordPort,
)
from compiler.interpreter.interpreter import physical_weights
from compiler.ir.program import Program
from msnn.agreement.judgement import (
    Arrays,
    Beginning,
    Judgement,
    Proof,
    labelled,
    labelled_first,
)
from msnn.data.dataset import FloatArray


def judged_words(
    program: Program,
    weights: Mapping[str, FloatArray],
    format: str,
    judged: Judgement,
    most_steps: int,
) -> Judgement:
    """The first steps along the inputs of the judge, rounded to words.

    All arrays are the numbers that words stand for, which float64 holds exactly. Windows begin and
    end where those of the export do, and inputs that it does not have are left out.
    """
    numbers = physical_weights(program, weights)
    integers = integer_program(program, numbers, WIDTHS[format])
    windows = {
        port.name: _words(port, judged.beginning.window(port.name, first, port.axes[-1].size))
        for port, first in zip(integers.windows, integers.window_firsts, strict=True)
    }
    steps = min(most_steps, judged.steps)
    ports = {entry.port.name: entry.port for entry in integers.inputs}
    inputs = {
        name: _words(port, judged.inputs[name][:steps], steps) for name, port in ports.items()
    }
    state = reset(integers, {name: words.ravel().tolist() for name, words in windows.items()})
    memories, outputs = [state.memories], list[dict[str, list[int]]]()
    for k in range(steps):
        words = {name: given[k].ravel().tolist() for name, given in inputs.items()}
        outputs.append(step(integers, state, words).outputs)
        memories.append(state.memories)
    found = Judgement(
        beginning=Beginning(
            windows={port.name: _numbers(port, windows[port.name]) for port in integers.windows},
            window_firsts=integers.first_samples,
            states={},
        ),
        inputs={name: _numbers(ports[name], words) for name, words in inputs.items()},
        states={},
        outputs={port.name: _run(port, outputs) for port, _ in integers.outputs},
        next_states={},
    )
    states = {memory.name: _run(memory, memories) for memory in integers.memories}
    return replace(found, proof=_proof(ExactStepper(program, numbers), integers, found, states))


def _proof(
    stepper: ExactStepper, integers: IntegerProgram, judged: Judgement, states: Arrays
) -> Proof:
    """The same steps in real numbers, and the first states, which both keep within their range.

    `states` are those before each step and after the last.
    """
    steps = judged.steps
    begun = {name: values[:1] for name, values in states.items()}
    before = {name: values[:steps] for name, values in states.items()}
    exact = stepper.steps(judged.inputs, before, steps)
    first = stepper.start(judged.beginning.windows, integers.first_samples)
    ends = {memory.name: _ends(memory) for memory in integers.memories}
    firsts = {name: np.clip(first[name], *ends[name]) for name in begun}
    return Proof(
        values=labelled(judged.outputs, {name: values[1:] for name, values in states.items()})
        | labelled_first(begun),
        exact=labelled(exact.outputs, {name: exact.next_states[name] for name in states})
        | labelled_first(firsts),
        bounds=_bounds(integers),
    )


def _bounds(integers: IntegerProgram) -> dict[str, float]:
    """What is proved of every value, and what float64 may lose of it."""
    ends = {port.name: _ends(port) for port, _ in integers.outputs}
    kept = {memory.name: _ends(memory) for memory in integers.memories}

    def bound(error: StepError) -> float:
        low, high = (kept if error.is_state else ends)[error.name]
        return error.largest + LOST * max(-low, high)

    outputs, states = (
        {e.name: bound(e) for e in integers.step_errors if e.is_state is is_state}
        for is_state in (False, True)
    )
    firsts = {error.name: bound(error) for error in integers.start_errors}
    return labelled(outputs, states) | labelled_first(firsts)


def _ends(words: WordPort | IntegerMemory) -> tuple[float, float]:
    """What the lowest and the highest word stand for."""
    return math.ldexp(words.low, -words.fraction), math.ldexp(words.high, -words.fraction)


def _run(
    words: WordPort | IntegerMemory, steps: Sequence[Mapping[str, Sequence[int]]]
) -> NDArray[np.float64]:
    """What the words of one name stand for in each step, (steps, *shape)."""
    shape = tuple(axis.size for axis in words.axes)
    found = np.array([step[words.name] for step in steps], np.int64)
    return _numbers(words, found.reshape(len(steps), *shape))


def _words(port: WordPort, values: NDArray[Any], *steps: int) -> NDArray[np.int64]:
    """The nearest words, (*steps, *shape)."""
    words = np.clip(np.rint(np.ldexp(values, port.fraction)), port.low, port.high)
    return words.reshape(*steps, *(axis.size for axis in port.axes)).astype(np.int64)


def _numbers(words: WordPort | IntegerMemory, values: NDArray[Any]) -> NDArray[np.float64]:
    """What words stand for."""
    return np.ldexp(values.astype(np.float64), -words.fraction)

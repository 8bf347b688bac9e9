"""Runs the fixed-point reference interpreter over the inputs of a recorded simulation."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
from msnn.features.fixed_point.compile.compile_integers import integer_program
from msnn.features.fixed_point.deviation import LOST, ExactStepper
from msnn.features.fixed_point.golden.equalities import golden_equalities
from msnn.features.fixed_point.integers.interpret import Words, reset, step
from msnn.features.fixed_point.integers.program import (
    WIDTHS,
    IntegerMemory,
    IntegerProgram,
    StepError,
    WordPort,
)

_EQUAL_STEPS, _SEED = 25, 3
"""Number of steps of each run with equal sides of comparisons, and the seed of these runs."""


def judged_words(
    program: Program,
    weights: Mapping[str, FloatArray],
    format: str,
    judged: Judgement,
    most_steps: int,
) -> Judgement:
    """Runs the integer program for the inputs of the simulation `judged`, rounded to words of the
    `format`, `q15` or `q31`; returns its results as a Judgement with proved error bounds.

    It stops after `most_steps` steps. All arrays contain the real values of the words, which
    float64 represents exactly. Windows have the extent of those of the export; inputs that the
    export lacks are omitted.
    """
    numbers = physical_weights(program, weights)
    integers = integer_program(program, numbers, WIDTHS[format])
    windows = {
        # windows of an export in fixed point may begin and end elsewhere than those of the judge
        port.name: _words(port, judged.beginning.window(port.name, first, port.axes[-1].size))
        for port, first in zip(integers.windows, integers.window_firsts, strict=True)
    }
    steps = min(most_steps, judged.steps)
    ports = {entry.port.name: entry.port for entry in integers.inputs}
    inputs = {
        name: _words(port, judged.inputs[name][:steps], steps) for name, port in ports.items()
    }
    first = {name: words.ravel().tolist() for name, words in windows.items()}
    along = [
        {name: given[k].ravel().tolist() for name, given in inputs.items()} for k in range(steps)
    ]
    run = _Run.of(integers, first, along)
    found = Judgement(
        beginning=Beginning(
            windows={port.name: _numbers(port, windows[port.name]) for port in integers.windows},
            window_firsts=integers.first_samples,
            states={},
        ),
        inputs={name: _numbers(ports[name], words) for name, words in inputs.items()},
        states={},
        outputs=run.outputs,
        next_states={},
    )
    return replace(found, proof=_proof(ExactStepper(program, numbers), integers, run))


@dataclass(frozen=True, slots=True)
class _Run:
    """A run of the integer interpreter: real values of its words, (steps, *shape) each."""

    windows: Arrays
    inputs: Arrays
    states: Arrays
    """Before each step and after the last one, (steps + 1, *shape)."""
    outputs: Arrays

    @staticmethod
    def of(integers: IntegerProgram, windows: Words, inputs: Sequence[Words]) -> _Run:
        """Runs the interpreter from `windows`, the flat words around the first step, with the
        `inputs` of each step.
        """
        state = reset(integers, windows)
        memories, outputs = [state.memories], list[Words]()
        for words in inputs:
            outputs.append(step(integers, state, words).outputs)
            memories.append(state.memories)
        return _Run(
            {port.name: _run(port, [windows])[0] for port in integers.windows},
            {entry.port.name: _run(entry.port, inputs) for entry in integers.inputs},
            {memory.name: _run(memory, memories) for memory in integers.memories},
            {port.name: _run(port, outputs) for port, _ in integers.outputs},
        )


def _proof(stepper: ExactStepper, integers: IntegerProgram, along: _Run) -> Proof:
    """The steps and the first states of the run `along`, compared with the same ones in float64,
    and the proved error bounds.

    Further runs follow in which both sides of comparisons are equal. Recordings rarely contain
    equality, and `<` differs from `<=` nowhere else.
    """
    runs = [along]
    # beside the record: words that make both sides of a comparison equal are drawn for it
    for golden in golden_equalities(integers, _EQUAL_STEPS, _SEED):
        runs.append(_Run.of(integers, golden.start.windows, golden.inputs))
    pairs = [_both(stepper, integers, run) for run in runs]
    of_record = {name: len(values) for name, values in pairs[0][0].items()}
    values, exact = (_joined(parts) for parts in zip(*pairs, strict=True))
    return Proof(values, exact, _bounds(integers), of_record)


def _both(
    stepper: ExactStepper, integers: IntegerProgram, run: _Run
) -> tuple[dict[str, NDArray[Any]], dict[str, NDArray[Any]]]:
    """The outputs, next and first states of a run, and those of the same steps in float64, by their
    names in messages.
    """
    count = len(next(iter(run.outputs.values())))
    begun = {name: values[:1] for name, values in run.states.items()}
    before = {name: values[:count] for name, values in run.states.items()}
    after = {name: values[1:] for name, values in run.states.items()}
    exact = stepper.steps(run.inputs, before, count)
    first = stepper.start(run.windows, integers.first_samples)
    ends = {memory.name: _ends(memory) for memory in integers.memories}
    # fixed point saturates at the ends of its words, real numbers do not
    firsts = {name: np.clip(first[name], *ends[name]) for name in begun}
    following = {name: exact.next_states[name] for name in after}
    return (
        labelled(run.outputs, after) | labelled_first(begun),
        labelled(exact.outputs, following) | labelled_first(firsts),
    )


def _joined(parts: Sequence[Mapping[str, NDArray[Any]]]) -> dict[str, NDArray[Any]]:
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _bounds(integers: IntegerProgram) -> dict[str, float]:
    """The error bound of every output, next and first state, by its name in messages: the proved
    bound plus the float64 rounding error.
    """
    ends = {port.name: _ends(port) for port, _ in integers.outputs}
    kept = {memory.name: _ends(memory) for memory in integers.memories}

    def bound(error: StepError) -> float:
        low, high = (kept if error.is_state else ends)[error.name]
        # what float64 loses of the exact step counts by the size of the value
        return error.largest + LOST * max(-low, high)

    outputs, states = (
        {e.name: bound(e) for e in integers.step_errors if e.is_state is is_state}
        for is_state in (False, True)
    )
    firsts = {error.name: bound(error) for error in integers.start_errors}
    return labelled(outputs, states) | labelled_first(firsts)


def _ends(words: WordPort | IntegerMemory) -> tuple[float, float]:
    """The real values of the smallest and the largest word of a port or memory."""
    return math.ldexp(words.low, -words.fraction), math.ldexp(words.high, -words.fraction)


def _run(
    words: WordPort | IntegerMemory, steps: Sequence[Mapping[str, Sequence[int]]]
) -> NDArray[np.float64]:
    """The real values of the words with one name in each step, (steps, *shape)."""
    shape = tuple(axis.size for axis in words.axes)
    found = np.array([step[words.name] for step in steps], np.int64)
    return _numbers(words, found.reshape(len(steps), *shape))


def _words(port: WordPort, values: NDArray[Any], *steps: int) -> NDArray[np.int64]:
    """The words of a port that are nearest to real values, within the range, (*steps, *shape)."""
    # to the nearest word, and within the words that there are
    words = np.clip(np.rint(np.ldexp(values, port.fraction)), port.low, port.high)
    return words.reshape(*steps, *(axis.size for axis in port.axes)).astype(np.int64)


def _numbers(words: WordPort | IntegerMemory, values: NDArray[Any]) -> NDArray[np.float64]:
    """The real values of the words of a port or memory, in the same shape."""
    return np.ldexp(values.astype(np.float64), -words.fraction)

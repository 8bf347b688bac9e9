"""What the integer interpreter, the judge of C in fixed point, does along a judge's free run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.fixed_point.write_fixed_c import WIDTHS
from compiler.fixed_point.compile_integers import integer_program
from compiler.fixed_point.integers.interpret import reset, step
from compiler.fixed_point.integers.program import IntegerProgram, WordPort
from compiler.interpreter.interpreter import physical_weights
from compiler.ir.program import Program
from msnn.agreement.judge import Arrays, Judgement
from msnn.data.dataset import FloatArray
from msnn.exports.export import FixedPoint


@dataclass(frozen=True, slots=True)
class JudgedWords:
    """Words (steps, *shape) by the names of the spec."""

    program: IntegerProgram
    steps: int
    windows: Arrays
    inputs: Arrays
    outputs: Arrays

    def real(self, words: Mapping[str, NDArray[Any]]) -> Arrays:
        """Words of outputs as the numbers that they stand for."""
        ports = (port for port, _ in self.program.outputs)
        return {p.name: np.ldexp(words[p.name].astype(np.float64), -p.fraction) for p in ports}


def judged_words(
    program: Program,
    weights: Mapping[str, FloatArray],
    format: FixedPoint,
    judged: Judgement,
    most_steps: int,
) -> JudgedWords:
    """The first steps along the inputs of the judge, rounded to words."""
    integers = integer_program(program, physical_weights(program, weights), WIDTHS[format])
    windows = {
        port.name: _words(port, judged.window(port.name, first, port.axes[-1].size))
        for port, first in zip(integers.windows, integers.window_firsts, strict=True)
    }
    steps = min(most_steps, len(next(iter(judged.outputs.values()))))
    inputs = {
        entry.port.name: _words(entry.port, judged.inputs[entry.port.name][:steps], steps)
        for entry in integers.inputs
    }
    state = reset(integers, {name: words.ravel().tolist() for name, words in windows.items()})
    answers = [
        step(integers, state, {name: words[k].ravel().tolist() for name, words in inputs.items()})
        for k in range(steps)
    ]
    outputs = {
        port.name: np.array([answer.outputs[port.name] for answer in answers]).reshape(
            steps, *(axis.size for axis in port.axes)
        )
        for port, _ in integers.outputs
    }
    return JudgedWords(integers, steps, windows, inputs, outputs)


def _words(port: WordPort, values: NDArray[Any], *steps: int) -> NDArray[np.int64]:
    """The nearest words, (*steps, *shape)."""
    words = np.clip(np.rint(np.ldexp(values, port.fraction)), port.low, port.high)
    return words.reshape(*steps, *(axis.size for axis in port.axes)).astype(np.int64)

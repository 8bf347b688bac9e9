"""Runs the integer interpreter, the judge of C in fixed point, along a judge's free run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.fixed_point.write_fixed_c import WIDTHS
from compiler.fixed_point.compile_integers import integer_program
from compiler.fixed_point.integers.interpret import reset, step
from compiler.fixed_point.integers.program import WordPort
from compiler.interpreter.interpreter import physical_weights
from compiler.ir.program import Program
from msnn.agreement.judgement import Beginning, Judgement
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
    integers = integer_program(program, physical_weights(program, weights), WIDTHS[format])
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
    firsts = zip(integers.windows, integers.window_firsts, strict=True)
    return Judgement(
        beginning=Beginning(
            windows={port.name: _numbers(port, windows[port.name]) for port in integers.windows},
            window_firsts={port.name: first for port, first in firsts},
            states={},
        ),
        inputs={name: _numbers(ports[name], words) for name, words in inputs.items()},
        states={},
        outputs={port.name: _numbers(port, outputs[port.name]) for port, _ in integers.outputs},
        next_states={},
    )


def _words(port: WordPort, values: NDArray[Any], *steps: int) -> NDArray[np.int64]:
    """The nearest words, (*steps, *shape)."""
    words = np.clip(np.rint(np.ldexp(values, port.fraction)), port.low, port.high)
    return words.reshape(*steps, *(axis.size for axis in port.axes)).astype(np.int64)


def _numbers(port: WordPort, words: NDArray[Any]) -> NDArray[np.float64]:
    """What words stand for."""
    return np.ldexp(words.astype(np.float64), -port.fraction)

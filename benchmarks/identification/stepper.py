"""Measures the time of a call of `msnn.stepper(…).step`, compared with the interpreter.

python benchmarks/identification/stepper.py [--write] # writes stepper.md
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import msnn
from msnn.stepping import Stepper

SPECS = {
    "three states, one input": """
msnn: 1
name: spring
sample_time: 0.01 s
inputs: {F: N}
parameters: {k: 40, d: 1.5, c: 8}
states: {x: {der: v}, v: {der: F - k*x - 30*x**3 - d*v - c*z}, z: {der: v - 2*z}}
outputs: {x_next: next(x), v_next: next(v)}
""",
    "six joints": """
msnn: 1
name: joints
sample_time: 0.01 s
dims: {joint: 6}
inputs: {tau: {dims: joint}}
states: {q: {dims: joint, der: w}, w: {dims: joint, der: tau - sin(q) - 0.1*w}}
outputs: {q_next: next(q)}
""",
    "windows of 20, an mlp of 16": """
msnn: 1
name: net
sample_time: 0.01 s
inputs: {u: {}, x: {}}
layers: {f: {mlp: {hidden: 16}}, h: {fir: {window: 20}}}
outputs: {y: "f(x) + h(u)"}
""",
}
_TEXT = """\
# A step from Python

Written by `python benchmarks/identification/stepper.py --write`: microseconds of the processor for
a call of `msnn.stepper(model).step(…)`, the median of five runs of 20,000 calls (200 in the
interpreter).

| model | its C, µs | the interpreter, µs |
|---|---|---|
{rows}
"""
INPUTS: dict[str, dict[str, object]] = {
    "three states, one input": {"F": 0.1},
    "six joints": {"tau": np.zeros(6)},
    "windows of 20, an mlp of 16": {"u": 0.1, "x": 0.1},
}


def main() -> None:
    """Measures, and prints one row per model."""
    parser = argparse.ArgumentParser(description="Measures steps from Python.")
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    rows: list[str] = []
    with tempfile.TemporaryDirectory() as place:
        for name, text in SPECS.items():
            path = Path(place) / "model.msnn.yaml"
            path.write_text(text, encoding="utf-8")
            model = msnn.load(path)
            compiled = msnn.stepper(model)
            os.environ["CC"] = "no-such-compiler"
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                interpreted = msnn.stepper(model)
            del os.environ["CC"]
            fast = microseconds(compiled, INPUTS[name], 20_000)
            slow = microseconds(interpreted, INPUTS[name], 200)
            rows.append(f"| {name} | {fast:.1f} | {slow:.0f} |")
            print(rows[-1], flush=True)
    if given.write:
        page = _TEXT.format(rows="\n".join(rows))
        Path(__file__).with_name("stepper.md").write_text(page, encoding="utf-8")


def microseconds(stepper: Stepper, inputs: dict[str, object], count: int) -> float:
    """CPU time per step: the median of five runs of `count` steps."""

    def run() -> float:
        began = time.process_time()
        for _ in range(count):
            stepper.step(**inputs)
        return (time.process_time() - began) / count * 1e6

    return statistics.median(run() for _ in range(5))


if __name__ == "__main__":
    main()

"""Trains every model over 25,000 steps and prints the peak of its memory in bytes."""

from __future__ import annotations

import resource
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from backends.native.kernel import Kernel
from backends.native.variables import Method, Rule
from compiler.ir.program import Program
from compiler.passes.close_loop import close_loop
from tests.language.compiled import compiled
from tests.native.test_kernel import MODELS, initial, log_of

STEPS = 25_000
ARMS = """
dims: {joint: 3}
inputs: {u: {dims: joint}}
parameters:
  J: {dims: joint, init: [0.6, 0.8, 1.0], min: 0.1}
  c: {dims: joint, init: [0.8, 0.9, 1.1]}
  k: {dims: joint, init: [4, 5, 6]}
integrator: {rk4: {substeps: 8}}
states:
  q: {der: w, dims: joint}
  w: {der: (u - c*w - k*sin(q) - 0.3*tanh(w / 0.2)) / J, dims: joint}
targets: {angle: {dims: joint}}
outputs: {q_next: {expr: next(q), predicts: "angle[t+1]"}}
"""


def calm(program: Program) -> dict[str, NDArray[np.float64]]:
    """Initial weights with small filters: none of the models grows without end over long times."""
    weights = initial(program)
    return {name: w * 0.1 if name.endswith(".weight") else w for name, w in weights.items()}


def main() -> None:
    for text, closed in (*MODELS.values(), (ARMS, ())):
        program = close_loop(compiled(text), closed)
        kernel = Kernel(program, "float32")
        rates = {parameter.name: 1e-4 for parameter in program.parameters}
        variables = kernel.variables(
            Rule(method=Method.ADAM, beta1=0.9, beta2=0.999, epsilon=1e-8), calm(program), rates
        )
        t0 = np.arange(10, 26)
        groups, bounds = kernel.batches(t0, np.full(len(t0), STEPS), len(t0))
        data = kernel.data(log_of(program, STEPS + 50))
        done, _, _ = kernel.train(data, groups, bounds, variables, [1.0] * len(program.losses))
        assert done == 1
    sys.stdout.write(str(peak_memory()))


def peak_memory() -> int:
    """Bytes. Of Linux its own figure: `getrusage` counts what the process was forked from too."""
    status = Path("/proc/self/status")
    if status.exists():
        (peak,) = (x for x in status.read_text().splitlines() if x.startswith("VmHWM:"))
        return int(peak.split()[1]) * 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


if __name__ == "__main__":
    main()

"""Small models that together use every rule of differentiation."""

from __future__ import annotations

import numpy as np

from compiler.ir.scalars import SCALAR_FUNCTIONS
from compiler.passes.close_loop import close_loop
from tests.language.compiled import compiled
from tests.native.graph_slopes import Problem, problem
from tests.native.test_kernel import MODELS, initial, log_of

COVERING = ("memory", "arm", "vehicle", "learned_start", "filtered_joints")
"""Models of the suite's tests whose kernels the emitter's mutants are made of."""

_BRANCHES = """
dims: {joint: 3}
inputs: {u: {dims: joint}, x: m}
parameters: {a: 0.4, b: {dims: joint, init: [0.3, -0.6, 0.9]}, c: 1.3, low: -0.5, high: 0.6}
equations:
  least: min(a * u, b)
  most: max(b * u, 0.3 * a)
  inside: clip(c * u, low, high)
  taken: where(u > 0.1, a * u * u, b / (1 + c * c))
  part: concat(x * a, tanh(c * x), 0.5 * a)
  named: sum(b * u) / (2 + a * b)
outputs:
  x_next:
    expr: sum(least + most + inside + taken * named) - sum(part) * a - abs(c) * x / (3 + a)
    predicts: "x[t+1]"
"""


def covering_problems() -> list[Problem]:
    """The models, the quickest first."""
    texts = [
        (_functions(), ()),
        (_BRANCHES, ()),
        *(MODELS[name] for name in (*COVERING, "joints", "two_windows", "classes", "stiff")),
    ]
    found: list[Problem] = []
    for text, closed in texts:
        program = close_loop(compiled(text), closed)
        rows = np.arange(10, 15)
        found.append(problem(program, log_of(program), rows, 6, initial(program)))
    return found


def _functions() -> str:
    """A model with every scalar function of a parameter times an input, inside its domain."""
    terms: list[str] = []
    for name, row in SCALAR_FUNCTIONS.items():
        spans = [(max(low, -2.0), min(high, 2.0)) for low, high in row.domain]
        args = [f"({(a + b) / 2!r} + {(b - a) / 5!r} * k{i} * u)" for i, (a, b) in enumerate(spans)]
        terms.append(f"{args[0]} ** {args[1]}" if name == "pow" else f"{name}({', '.join(args)})")
    head = "inputs: {u: {}}\ntargets: {z: {}}\nparameters: {k0: 0.9, k1: 0.7}\n"
    return head + f'outputs: {{y: {{expr: "{" + ".join(terms)}", predicts: "z"}}}}\n'

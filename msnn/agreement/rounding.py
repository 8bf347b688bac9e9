"""Finds what rounding costs a step, and how near to the judge a target can therefore come."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

import numpy as np

from compiler.interpreter.bounded import exact
from compiler.interpreter.interpreter import Interpreter
from compiler.interpreter.rounding import BoundedGraph
from compiler.ir.program import Program
from msnn.agreement.deviation import deviations
from msnn.agreement.judgement import Arrays, Judgement
from msnn.agreement.record import AgreementRecord
from msnn.data.dataset import FloatArray

V = TypeVar("V")

STEP_LIMIT = {"float64": 1e-12, "float32": 1e-5}
"""One step in the arithmetic of the target from the judge's state: what is always granted."""

ORDERS = 16.0
"""How much more than the interpreter another order of the same operations may be off.

Any order of n operations errs by at most n ε Σ|terms|, and along a record the worst of hundreds of
steps comes near to √n of it; 16 covers sums of 256 terms."""


def single_steps(
    program: Program, weights: Mapping[str, FloatArray], record: AgreementRecord, wanted: Judgement
) -> dict[str, Arrays]:
    """Outputs and next states of the interpreter in float32, each step from the judge's state."""
    log = {name: series.astype(np.float32) for name, series in record.log.items()}
    states = {name: values.astype(np.float32) for name, values in wanted.states.items()}
    rows = record.t0 + np.arange(record.steps)
    with np.errstate(all="ignore"):  # what overflows in single precision is seen in its values
        values = Interpreter(program, weights, np.float32).step(log, rows, states, losses=False)
    shape = (record.steps,)
    return {
        "outputs": {n: np.broadcast_to(v, shape + v.shape[1:]) for n, v in values.outputs.items()},
        "next_states": {
            n: np.broadcast_to(v, shape + v.shape[1:]) for n, v in values.next_states.items()
        },
    }


def labelled(outputs: Mapping[str, V], next_states: Mapping[str, V]) -> dict[str, V]:
    """Outputs and next states under the names that messages give them."""
    named = {f"`{name}`": values for name, values in outputs.items()}
    return named | {f"the state `{name}`": values for name, values in next_states.items()}


def rounding_errors(single: Mapping[str, Arrays], wanted: Judgement) -> dict[str, float]:
    """The worst deviation of each output and next state in single precision."""
    return deviations(
        labelled(single["outputs"], single["next_states"]),
        labelled(wanted.outputs, wanted.next_states),
    )


def within_rounding(
    program: Program,
    weights: Mapping[str, FloatArray],
    record: AgreementRecord,
    wanted: Judgement,
    found: Arrays,
) -> set[str]:
    """The labels of values found that are no farther from the judge than float64 may round them.

    A bound of its own for every value (decision 0180): one that is nothing but what rounding leaves
    of a difference of equal numbers says by its magnitude nothing of how large these were.
    """
    judged = labelled(wanted.outputs, wanted.next_states)
    nodes = {f"`{output.name}`": output.node for output in program.outputs}
    nodes |= {f"the state `{state.name}`": state.next for state in program.states}
    named = {name: nodes[name] for name in found if name in nodes}
    graph = BoundedGraph(program.step, named.values(), weights, np.dtype(np.float64))
    rows = record.t0 + np.arange(record.steps)
    leaves = {name: exact(values) for name, values in wanted.states.items()}
    values = graph.run(record.log, rows, leaves)
    inside: set[str] = set()
    for name, node in named.items():
        count = len(found[name])
        # both are within the spread of the exact value
        spread = 2.0 * np.broadcast_to(values[node].spread(graph.unit), judged[name].shape)
        if np.all(np.abs(found[name] - judged[name][:count]) <= spread[:count]):
            inside.add(name)
    return inside


def step_limit(dtype: str, rounding: float) -> float:
    """The deviation that a value is granted which rounds off by so much in single precision.

    Rounding errors scale with the precision, whatever magnifies them: a difference of near numbers,
    a division by a short sample time.
    """
    share = float(np.finfo(dtype).eps) / float(np.finfo(np.float32).eps)
    return max(STEP_LIMIT[dtype], ORDERS * rounding * share if np.isfinite(rounding) else 0.0)

"""Determines the effect of rounding on single steps, and the achievable accuracy of a target."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from compiler.interpreter.bounded import exact
from compiler.interpreter.interpreter import Interpreter, physical_weights
from compiler.interpreter.rounding import BoundedGraph
from compiler.ir.program import Program
from msnn.agreement.judging.judgement import Arrays, Judgement, labelled, labelled_first
from msnn.agreement.judging.record import AgreementRecord
from msnn.data.dataset import FloatArray

STEP_LIMIT = {"float64": 1e-12, "float32": 1e-5}
"""Tolerance of one step from reference states, in the arithmetic of the target."""

ORDERS = 16.0
"""Factor between rounding errors of another order of operations and those of the interpreter.

Any order of n operations has an error of at most n ε Σ|terms|. The maximum over hundreds of steps
comes close to √n of it; 16 covers sums of 256 terms.
"""


def single_steps(
    program: Program, weights: Mapping[str, FloatArray], record: AgreementRecord, wanted: Judgement
) -> dict[str, Arrays]:
    """Outputs and next states of the interpreter in float32, each step from the reference state."""
    # states are those of float64, rounded: a step is compared, not the way to it
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


def first_states(
    program: Program, weights: Mapping[str, FloatArray], record: AgreementRecord
) -> Arrays:
    """Initial states of the interpreter in float32, (1, *shape) each."""
    log = {name: series.astype(np.float32) for name, series in record.log.items()}
    with np.errstate(all="ignore"):
        return Interpreter(program, weights, np.float32).start(log, record.t0)


def within_rounding(
    program: Program,
    weights: Mapping[str, FloatArray],
    record: AgreementRecord,
    wanted: Judgement,
    found: Arrays,
) -> dict[str, NDArray[np.bool_]]:
    """Masks of values whose difference from the reference is within the rounding bound of float64.

    Every value has its own bound (decision 0180): a difference of nearly equal numbers is small,
    although its rounding error depends on their size. Also marks the steps without a bound, which
    are not compared.
    """
    steps = labelled(
        {output.name: output.node for output in program.outputs},
        {state.name: state.next for state in program.states},
    )
    firsts = labelled_first({state.name: state.start for state in program.states})
    begin, rows = np.array([record.t0]), record.t0 + np.arange(record.steps)
    states = {name: exact(values) for name, values in wanted.states.items()}
    judged = labelled(wanted.outputs, wanted.next_states) | labelled_first(wanted.states)
    physical = physical_weights(program, weights)
    inside: dict[str, NDArray[np.bool_]] = {}
    for graph, nodes, t, leaves in (
        (program.start, firsts, begin, {}),
        (program.step, steps, rows, states),
    ):
        named = {name: node for name, node in nodes.items() if name in found}
        bounds = BoundedGraph(graph, named.values(), physical, np.dtype(np.float64))
        values = bounds.run(record.log, t, leaves)
        for name, node in named.items():
            of_judge = judged[name][: len(found[name])]
            # both are within the spread of the exact value
            spread = np.broadcast_to(2.0 * values[node].spread(bounds.unit), of_judge.shape)
            apart = np.abs(found[name] - of_judge)
            # all of a value, or none: a value of which one step is too far has a fault
            if np.all(apart <= spread):
                # an infinite bound lets anything pass: there nothing was compared
                unbounded = (np.isinf(spread) & (apart > 0)).reshape(len(spread), -1)
                inside[name] = np.any(unbounded, axis=1)
    return inside


def step_limit(dtype: str, rounding: float) -> float:
    """The tolerance of a value with this rounding error in single precision.

    Rounding errors scale with the precision, whatever amplifies them: a difference of close
    numbers, or a division by a short sample time.
    """
    # errors of rounding scale with the precision
    share = float(np.finfo(dtype).eps) / float(np.finfo(np.float32).eps)
    return max(STEP_LIMIT[dtype], ORDERS * rounding * share if np.isfinite(rounding) else 0.0)

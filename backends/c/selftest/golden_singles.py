"""Golden vectors of single steps, each with its own start, states and parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.c.interface.interface import Interface
from backends.c.interface.status import StatusBit
from backends.c.selftest.singles.decisions import Decisions
from backends.c.selftest.singles.telling_steps import telling_steps
from backends.c.selftest.singles.trial_steps import TrialSteps, joined_trials
from backends.c.selftest.vectors.golden_starts import GoldenStart
from backends.c.selftest.vectors.golden_vectors import GoldenVectors
from backends.c.selftest.vectors.policy_reference import apply_policy, first_held
from backends.c.selftest.vectors.state_reference import (
    equation_bits,
    next_state_bits,
    restarted,
    saturation_bits,
)
from compiler.ir.program import Program

Array = NDArray[Any]


_LARGEST = 8000
"""Maximum number of elements of a step and its Jacobian; thousands of larger steps are too slow."""


@dataclass(frozen=True, slots=True)
class GoldenSingles:
    """Independent single steps."""

    starts: list[int]
    """Index of the run start that `reset` receives before each step."""
    tuned: list[dict[int, float]]
    """Parameters of each step that differ from the trained ones, by their index in the struct."""
    linearized: int
    """Number of first steps for which only the Jacobian uses changed parameters."""
    vectors: GoldenVectors
    """The states written before each step, and its results; all (count, …)."""

    @property
    def tunes(self) -> bool:
        """True if any step has changed parameters."""
        return any(self.tuned)


def golden_singles(
    program: Program,
    interface: Interface,
    weights: Mapping[str, Array],
    starts: Sequence[GoldenStart],
    seed: int,
) -> GoldenSingles | None:
    """Steps that detect errors which plain golden steps miss; None if there are none.

    Also None for a large step, which only golden runs test.
    """
    steps = TrialSteps(program, interface, weights, starts)
    if steps.computed > _LARGEST:
        return None
    alone, others = telling_steps(steps, Decisions(program, interface), seed)
    if not (alone or others):
        return None
    trials = joined_trials([*alone, *others])
    # for steps of `alone` only the Jacobian uses changed parameters
    stepped = joined_trials([*map(steps.with_trained, alone), *others])
    count = len(trials)
    values, begun, inputs = steps.run(stepped), steps.begun(trials), steps.inputs(trials)
    first = {s.name: begun[s.name] for s in program.states if s.on_range == "reset"}
    status = np.zeros(count, np.uint32)
    after = {name: value.copy() for name, value in values.next_states.items()}
    for k in range(count):
        row = slice(k, k + 1)
        following, outputs, before = (
            {name: value[row] for name, value in each.items()}
            for each in (values.next_states, values.outputs, first)
        )
        bits = _input_bits(interface, {name: value[k] for name, value in inputs.items()})
        bits |= equation_bits(program, outputs, interface.options.dtype)
        bits |= saturation_bits(program, outputs)
        status[k] = bits | next_state_bits(interface, following)
        for name, value in restarted(interface, following, before).items():
            after[name][row] = value
    vectors = GoldenVectors(
        start=starts[0],
        written=steps.written(trials),
        inputs=inputs,
        # the policies replace none of these inputs
        seen=inputs,
        outputs={field.name: values.outputs[field.name] for field in interface.outputs},
        states=after,
        status=status,
        slopes=steps.matrices(trials),
    )
    tuned = trials.numbers[:, steps.tuned]
    # only changed parameters are written: most steps change a few of many
    places = [np.flatnonzero(row != steps.trained).tolist() for row in tuned]
    return GoldenSingles(
        trials.starts.tolist(),
        [{k: float(row[k]) for k in which} for row, which in zip(tuned, places, strict=True)],
        len(alone),
        vectors,
    )


def _input_bits(interface: Interface, inputs: Mapping[str, Array]) -> StatusBit:
    """The status bits of the input policies, which replace nothing here."""
    bits = StatusBit(0)
    for input in interface.inputs:
        name, dtype = input.field.name, interface.options.dtype
        held = first_held(input.port.signal, input.field.shape, dtype)
        bits |= apply_policy(input.port.signal, inputs[name], held, dtype)[1]
    return bits

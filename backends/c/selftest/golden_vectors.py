"""Makes golden vectors: drawn inputs, and what the interpreter answers in the same arithmetic."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.c.interface.interface import Interface
from backends.c.interface.status import Status
from backends.c.selftest.drawn_inputs import (
    Outside,
    StartPoint,
    drawn_record,
    drawn_series,
    knots_of,
)
from backends.c.selftest.first_steps import emptied, log_of_step, unset
from backends.c.selftest.golden_starts import GoldenStart, golden_start
from backends.c.selftest.policy_reference import apply_policy, first_held
from backends.c.selftest.state_reference import (
    equation_bits,
    next_state_bits,
    restarted,
    saturation_bits,
    with_checked,
)
from backends.c.selftest.written_states import Written, state_fields
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.program import Program
from compiler.jacobian.interpret import JacobianInterpreter

Array = NDArray[Any]
_ANYWHERE = StartPoint()


@dataclass(frozen=True, slots=True)
class GoldenVectors:
    """Values by name in the spec, in the type of the generated code; series are (steps, *shape)."""

    start: GoldenStart
    """Before the first step."""
    written: dict[str, Array]
    """States that a harness writes into the struct after that; empty if it writes none."""
    inputs: dict[str, Array]
    """As given to the step, invalid ones among them."""
    seen: dict[str, Array]
    """Inputs after what the policies made of them."""
    outputs: dict[str, Array]
    states: dict[str, Array]
    """After each step."""
    status: NDArray[np.uint32]
    slopes: dict[str, Array]
    """Matrices of the Jacobian before each step, (steps, rows, columns); empty without one."""


def golden_vectors(
    program: Program,
    interface: Interface,
    weights: Mapping[str, Array],
    steps: int,
    seed: int = 0,
    *,
    start: StartPoint | Outside | None = _ANYWHERE,
    opening: int = 0,
    invalid: int | None = None,
    written: Written | None = None,
) -> GoldenVectors:
    """`steps` steps from a drawn past, each from the states that the one before left.

    `start` says where in their ranges, or beyond, the states begin; with None they begin without a
    past, as after `init`. The first samples of each input, `opening` of them, are invalid; with
    `invalid` those of the past are, too, beginning with that kind (`drawn_record`). What is
    `written` stands in the struct before the first step.

    The generator is counter-based (Philox), so a seed gives the same numbers everywhere.
    """
    dtype = interface.options.dtype
    random = np.random.Generator(np.random.Philox(seed))
    record = drawn_record(program, random, start or _ANYWHERE, dtype, invalid=invalid)
    knots = knots_of(program, dtype)
    inputs = {
        input.field.name: drawn_series(input, steps, random, knots, opening)
        for input in interface.inputs
    }
    interpreter = Interpreter(with_checked(program), weights, dtype)
    begin = golden_start(interface, interpreter, record)
    states = written.into(begin.states) if written else begin.states
    fields = state_fields(interface) if written else ()
    put = {field.name: states[field.name][0] for field in fields}
    first = {s.name: begin.states[s.name] for s in program.states if s.on_range == "reset"}
    outputs = {f.name: np.empty((steps, *f.shape), dtype) for f in interface.outputs}
    status = np.zeros(steps, np.uint32)
    linearized = interface.jacobian and JacobianInterpreter(
        interface.jacobian.jacobian, program, weights, dtype
    )
    slopes: list[dict[str, Array]] = []
    following: list[Mapping[str, Array]] = []
    accepted = {name: np.empty_like(values) for name, values in inputs.items()}
    seen = {
        input.field.name: first_held(input.port.signal, input.field.shape, dtype)
        for input in interface.inputs
    }
    for k in range(steps):
        bits = Status(0)
        for input in interface.inputs:
            name = input.field.name
            checked = apply_policy(input.port.signal, inputs[name][k], seen[name], dtype)
            seen[name], bits = checked[0], bits | checked[1]
            accepted[name][k] = seen[name]
        if start is None and interface.from_record and k == 0:
            states = emptied(interface, states)
        if linearized is not None:
            slopes.append(linearized.matrices(*log_of_step(interface, seen), states))
        if start is None and interface.from_record:
            states = unset(interpreter, interface, states, log_of_step(interface, seen), k)
            waits = interface.from_record - (interface.filled_by_first if k > 0 else set())
            bits |= Status.UNINITIALISED if waits else Status(0)
        result = interpreter.step(*log_of_step(interface, seen), states, losses=False)
        for name, values in outputs.items():
            values[k] = result.outputs[name][0]
        bits |= equation_bits(program, result.outputs, dtype)
        bits |= saturation_bits(program, result.outputs)
        status[k] = bits | next_state_bits(interface, result.next_states)
        states = result.next_states | restarted(interface, result.next_states, first)
        following.append(states)
    names = slopes[0] if slopes else ()
    matrices = {name: np.concatenate([step[name] for step in slopes]) for name in names}
    remembered = {
        s.name: np.concatenate([step[s.name] for step in following]) for s in program.states
    }
    return GoldenVectors(
        start=begin,
        written=put,
        inputs=inputs,
        seen=accepted,
        outputs=outputs,
        states=remembered,
        status=status,
        slopes=matrices,
    )


def joined(runs: Sequence[GoldenVectors]) -> GoldenVectors:
    """The steps of all runs one after the other, with the start of the first."""
    return replace(
        runs[0],
        inputs=_one_after_the_other([run.inputs for run in runs]),
        seen=_one_after_the_other([run.seen for run in runs]),
        outputs=_one_after_the_other([run.outputs for run in runs]),
        states=_one_after_the_other([run.states for run in runs]),
        status=np.concatenate([run.status for run in runs]),
        slopes=_one_after_the_other([run.slopes for run in runs]),
    )


def _one_after_the_other(series: Sequence[Mapping[str, Array]]) -> dict[str, Array]:
    return {name: np.concatenate([each[name] for each in series]) for name in series[0]}

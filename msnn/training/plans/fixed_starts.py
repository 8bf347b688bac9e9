"""Finds the states whose initial value is correct only at the first row of a recording."""

from __future__ import annotations

from typing import assert_never

from compiler.ir.nodes import needed_over_time
from compiler.ir.program import Declared, History, LayerMemory, Program, State, Tape
from msnn.data.reads import reads
from msnn.errors.learning import training
from msnn.training.plans.stage_plan import StagePlan
from spec_schema.diagnostics.diagnostic import Diagnostic


def fixed_starts(plan: StagePlan) -> list[Diagnostic]:
    """Rule R7: an `init` that does not read data is the value at a recording's first row.

    Exempt are states that only mean "a run begins" and states that only losses use: an integral in
    a loss starts with the rollout. The caller must know that rollouts start inside recordings.
    """
    program = plan.rollout.program
    following = {state.name: state.next for state in program.states}
    outputs = [output.node for output in program.outputs]
    _, deployed = needed_over_time(program.step, following, outputs)
    found: list[Diagnostic] = []
    for state in program.states:
        match state.origin:
            case Declared():
                fixed = True
            case LayerMemory(starts_fresh_each_run):
                forgotten = plan.rollout.skip > 0  # what begins wrong fades before a row counts
                fixed = not starts_fresh_each_run and state.name in deployed and not forgotten
            case History() | Tape():
                fixed = False
            case _:
                assert_never(state.origin)
        if fixed and not _reads_log(program, state):
            of_call = isinstance(state.origin, LayerMemory)
            found.append(
                training.starts_elsewhere(plan.name, state.name, state.span, of_call=of_call)
            )
    return found


def _reads_log(program: Program, state: State) -> bool:
    return bool(reads(program.start, [state.start]))

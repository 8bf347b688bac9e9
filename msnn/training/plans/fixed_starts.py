"""Finds the states of a stage whose start is right at the first row of a record only."""

from __future__ import annotations

from typing import assert_never

from compiler.ir.liveness import needed_over_time
from compiler.ir.program import Declared, History, LayerMemory, Program, State, Tape
from msnn.data.reads import reads
from msnn.errors.learning import training
from msnn.training.plans.stage_plan import StagePlan
from spec_schema.diagnostics.diagnostic import Diagnostic


def fixed_starts(plan: StagePlan) -> list[Diagnostic]:
    """Rule R7: an `init` that reads no log is the value at the first row of a record.

    What says only of the run that it begins is right everywhere, and so is what only losses need:
    an integral in a loss is that of the rollout. It is for the caller to know that rollouts start
    inside records.
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

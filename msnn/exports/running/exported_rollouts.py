"""Runs rollouts in an export: writes the model, loads it, and feeds it the rows of the data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import get_args

import numpy as np

from backends.ports.step_interface import step_interface
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.program import Program
from compiler.passes.simplify import prune_outputs
from compiler.passes.to_step_form import to_step_form
from msnn.agreement.judge import beginning_at, inputs_at
from msnn.data.dataset import BoolArray, FloatArray
from msnn.data.rollout_rows import Runs
from msnn.errors import targets
from msnn.exports.export import load_export, plan_exports, write_export
from msnn.exports.table import listed
from msnn.exports.target import AnyPlan
from msnn.model.model import Model
from msnn.simulation.engines.engine import (
    Advance,
    Engine,
    EngineToOpen,
    ExportName,
    OpenedRollouts,
    first_places,
    interpreted_rollouts,
)
from msnn.simulation.engines.open_rollouts import known_engine
from msnn.simulation.rollout import LossSum
from spec_schema.diagnostics.diagnostic import Findings, SpecError
from spec_schema.registry import ARITHMETICS

Arrays = Mapping[str, FloatArray]


def chosen_engine(model: Model, name: str) -> Engine:
    """The engine with that name; an export uses the options of the spec's entry.

    Raises SpecError for an unknown name, MissingExtraError for a missing package.
    """
    known_engine(name)
    return _export_engine(model, name) if name in get_args(ExportName) else name


def _export_engine(model: Model, name: str) -> EngineToOpen:
    target = listed(name)
    target.require_writer()
    target.require_runner()
    findings = Findings()
    plans = plan_exports(model, [name], findings)
    if findings.failed:
        raise SpecError(findings.in_order, model.sources)
    (plan,) = plans
    # words have limits of their own: what they do along data is judged by `--check`
    if plan.dtype in ARITHMETICS:
        raise SpecError([targets.engine_of_words(plan.dtype)])

    def opened(program: Program, weights: Arrays, series: Arrays) -> OpenedRollouts:
        notes = (targets.losses_are_interpreted(name),) if program.losses else ()
        engine = ExportedRollouts(plan, program, weights, series)
        return OpenedRollouts(engine, plan.target.name, notes)

    return EngineToOpen(opened)


@dataclass(frozen=True, slots=True)
class ExportedRollouts:
    """An engine that simulates in an export: of `program`, with the options of `plan`.

    The loops and outputs are those of `program`, not of the plan.
    """

    plan: AnyPlan
    program: Program
    weights: Arrays
    series: Arrays

    def outputs(self, runs: Runs, advance: Advance) -> dict[str, FloatArray]:
        """Every output of the program, rollout after rollout."""
        names = [output.name for output in self.program.outputs]
        # the program of the rollout, not the plan's: what is closed is the caller's choice
        program = to_step_form(prune_outputs(self.program, names))
        # whole arrays, as the weights are given here
        plan = replace(self.plan, program=program, cuts=(), platforms=())
        interface = step_interface(program)
        # exports start from states: those that a spec takes from the log are its interpreter's
        starts = Interpreter(program, self.weights).start(self.series, runs.t0)
        total = int(runs.steps.sum())
        found = {
            output.name: np.empty((total, *program.step[output.node].type.shape))
            for output in program.outputs
        }
        with TemporaryDirectory(prefix="msnn-engine-") as folder:
            written = write_export(plan, self.weights, Path(folder))
            with load_export(plan, written) as loaded:
                for member, first in enumerate(first_places(runs).tolist()):
                    t0, steps = int(runs.t0[member]), int(runs.steps[member])
                    states = {name: values[member] for name, values in starts.items()}
                    # buffers from the log, states as the interpreter makes them
                    beginning = beginning_at(interface, self.series, t0, states)
                    rows = np.arange(t0, t0 + steps, dtype=np.int64)
                    inputs = inputs_at(interface, self.series, rows)
                    for name, values in loaded.run(beginning, inputs, steps).items():
                        found[name][first : first + steps] = values
                    advance(steps)
        return found

    def losses(
        self, runs: Runs, skip: int, scored: Mapping[str, BoolArray] | None, advance: Advance
    ) -> dict[str, LossSum]:
        """Every loss of the program, computed by the interpreter because an export has no
        losses.
        """
        judge = interpreted_rollouts(self.program, self.weights, self.series)
        return judge.losses(runs, skip, scored, advance)

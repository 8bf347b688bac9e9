"""Trains a program: stages in order, each from the best weights of the previous one (R12)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from compiler.ir.program import Program
from msnn.data.dataset import Dataset, FloatArray
from msnn.errors.learning import run_ends
from msnn.training.engines.devices import on_device
from msnn.training.engines.open_engine import try_optimizers
from msnn.training.plans.default_weights import with_default_weights
from msnn.training.plans.stage_data import stage_data
from msnn.training.plans.stage_plan import plan_stages
from msnn.training.ranks.training_ranks import weights_of_first
from msnn.training.reached import Reached
from msnn.training.records.checkpoint import Checkpoint
from msnn.training.records.interrupts import end_on_interrupt
from msnn.training.records.progress import Progress, Silent
from msnn.training.records.resumable_run import NotedProgress, open_run
from msnn.training.records.run_lock import held
from msnn.training.records.run_record import run_record
from msnn.training.records.safekeeping import Safekeeping
from msnn.training.records.tensorboard_curves import Curves, require_tensorboard
from msnn.training.records.training_options import TrainingOptions
from msnn.training.same_on_all import (
    check_same_training,
    checkpoint_of_first,
)
from msnn.training.starts.data_scales import with_data_scales
from msnn.training.starts.initial_weights_of_run import first_weights
from msnn.training.training_result import (
    TrainingResult,
)
from msnn.training.training_run import TrainingRun
from spec_schema.diagnostics.diagnostic import Findings, SpecError
from spec_schema.sections.training import Stage


def train(
    program: Program,
    data: Dataset,
    stages: Sequence[Stage],
    options: TrainingOptions | None = None,
    progress: Progress | None = None,
    weights: Mapping[str, FloatArray] | None = None,
) -> TrainingResult:
    """Trains the stages in order, and returns the best weights of the last.

    `program` is in window form. `weights` are the initial weights of the first stage, by default
    the initial values. Raises SpecError before training if stages and data do not fit,
    TrainingDivergedError, TrainingInterruptedError and MissingExtraError.
    """
    options, progress = options or TrainingOptions(), progress or Silent()
    # first of all: nothing is planned or compiled for a package that is missing
    if options.tensorboard:
        require_tensorboard()
    findings = Findings()
    plans = on_device(plan_stages(program, stages, findings), options.device, findings)
    datas = [stage_data(plan, data, findings) for plan in plans]
    # after the data were looked through: stages and data are told of together
    findings.raise_errors()
    # before the run's folder is made: an optimiser that torch refuses leaves nothing behind
    try_optimizers(program, plans)
    ranks = options.ranks
    # ranks must begin alike: each would draw its own, and train another model
    first = weights_of_first(ranks, first_weights(program, data) if weights is None else weights)
    weighed = with_default_weights([replace(plan, ranks=ranks) for plan in plans], data)
    plans = with_data_scales(weighed, data, first)
    ready = [(p, d) for p, d in zip(plans, datas, strict=True) if d is not None]
    record = run_record(program, plans, data, options.parts)
    # before a folder is made: of ranks that differ none leaves anything behind
    check_same_training(ranks, record)
    folder, checkpoint = open_run(program, options, record)
    checkpoint = checkpoint_of_first(ranks, folder and folder.checkpoint, checkpoint)
    path = None if folder is None else folder.path
    noted = NotedProgress(progress, folder)
    for warning in (*data.warnings, *findings.in_order):
        noted.warned(warning)
    curves = Curves(folder.path) if folder is not None and options.tensorboard else None
    # a fresh run is one that goes on from nothing
    begin = checkpoint or Checkpoint(ended=(), begin=first)
    run = TrainingRun(
        program=program,
        data=data,
        stages=ready,
        folder=folder,
        curves=curves,
        progress=noted,
        options=options,
        safe=Safekeeping(folder, noted, options.most_lost),
        reached=Reached(begin),
        first=first,
    )
    try:
        with (
            held(path),
            end_on_interrupt(second_kills=ranks is None) as stop_asked,
            run.reached.kept(folder, run.safe, noted),
        ):
            return run.through(begin, stop_asked)
    except OSError as error:
        # a full disk, a folder taken away: a message; of other files nothing is known here
        if folder is None or not folder.has(error):
            raise
        file, reason = str(error.filename), (error.strerror or str(error)).lower()
        kept = str(folder.weights) if folder.weights.is_file() else None
        can_go_on = folder.checkpoint.is_file()
        fault = run_ends.run_not_kept(file, reason, kept, can_go_on=can_go_on)
        raise SpecError((fault,)) from error
    finally:
        # whatever ended it: a session in Python would hold the file open
        noted.close()
        if curves is not None:
            curves.close()

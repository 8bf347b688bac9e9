"""`msnn train`: runs the stages of a spec on its data and keeps the weights."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from msnn.cli.arguments import (
    RUNS,
    DataRoot,
    EngineName,
    Folds,
    OutputFormat,
    ResultFormat,
    Settings,
    SpecFile,
)
from msnn.cli.exit_codes import ExitCode

if TYPE_CHECKING:
    from msnn.training.folds import FoldsResult
    from msnn.training.ranks.gloo_ranks import GlooRanks


def train(
    spec: SpecFile,
    data_root: DataRoot = None,
    settings: Settings = None,
    engine: Annotated[
        EngineName | None, typer.Option(help="What computes; replaces `engine:` of every stage.")
    ] = None,
    device: Annotated[
        str,
        typer.Option(
            metavar="cpu|cuda|cuda:N|auto", help="Where torch computes; auto: CUDA if there."
        ),
    ] = "cpu",
    resume: Annotated[
        bool,
        typer.Option(
            "--resume",
            help="Go on with the run that is named, or with the newest that has not ended.",
        ),
    ] = False,
    folds: Folds = False,
    tensorboard: Annotated[
        bool, typer.Option("--tensorboard", help="Write curves for TensorBoard beside the weights.")
    ] = False,
    out: Annotated[
        Path,
        typer.Option("-o", "--out", metavar="FOLDER", help="Trainings are kept in OUT/NAME/TIME."),
    ] = RUNS,
    format: OutputFormat = ResultFormat.TEXT,
) -> None:
    """Train the parameters on data.

    Each stage starts from the best weights of the previous one. Weights, metrics and the spec are
    saved in a folder per training; an interrupted or killed training can continue. With --folds
    there is one training per fold, each in a folder of its own; `latest` leads to the best. Under
    torchrun its processes share every batch: `torchrun --nproc-per-node 2 -m msnn train SPEC`.
    """
    from msnn.cli.ranks import joined_ranks

    with joined_ranks() as ranks:
        _train(
            spec,
            ranks,
            data_root=data_root,
            settings=settings,
            engine=engine,
            device=device,
            resume=resume,
            folds=folds,
            tensorboard=tensorboard,
            out=out,
            format=format,
        )


def _train(
    spec: Path,
    ranks: GlooRanks | None,
    *,
    data_root: Path | None,
    settings: list[str] | None,
    engine: EngineName | None,
    device: str,
    resume: bool,
    folds: bool,
    tensorboard: bool,
    out: Path,
    format: ResultFormat,
) -> None:
    from msnn.cli.console import (
        json_result,
        note,
        progress_stream,
        report,
        report_model,
        result,
    )
    from msnn.model.load import load_model, with_engine

    model = load_model(spec, settings or ())
    report_model(model)
    if engine is not None:
        model = with_engine(model, engine.value)

    # torch takes seconds to load: only a spec without mistakes waits for it
    from msnn.api import trainings
    from msnn.errors.learning.engines import one_process_alone
    from msnn.reports.training_summary import (
        Recorded,
        errors_note,
        parameters_table,
        stages_table,
        training_record,
        zeros_note,
    )
    from msnn.tables import is_live
    from msnn.training.records.progress import Lines, LinesOfStages
    from msnn.training.training_result import TrainingDivergedError, TrainingInterruptedError
    from spec_schema.diagnostics.diagnostic import SpecError

    is_terminal = is_live(progress_stream())
    # of folds every training ends, and their table comes after the last one
    lines = LinesOfStages(progress_stream(), terminal=is_terminal)
    shown = Lines(progress_stream(), terminal=is_terminal) if folds else lines
    progress = Recorded(shown)
    try:
        # folds are trainings side by side (decision 0110), ranks halves of one batch: nobody has
        # asked for both
        if folds and ranks is not None:
            raise SpecError((one_process_alone("`--folds`"),))
        if folds:
            every = trainings.train_folds(
                model,
                data_root=data_root,
                runs=out,
                resume=resume,
                tensorboard=tensorboard,
                device=device,
                progress=progress,
            )
            _show_folds(every, format)
            return
        found = trainings.train(
            model,
            data_root=data_root,
            runs=out,
            resume=resume,
            tensorboard=tensorboard,
            device=device,
            progress=progress,
            ranks=ranks,
        )
    except TrainingDivergedError as error:
        report([error.diagnostic], model.sources)
        kept = error.result.folder
        leads = "leads" if error.is_latest else "does not lead"
        note(f"the best weights before are kept in {kept}; `latest` {leads} there")
        raise typer.Exit(ExitCode.DIVERGED) from None
    except TrainingInterruptedError as error:
        # of folds the folder of the whole training, which is what `--resume` looks for
        kept = error.result.folder
        note(f"interrupted; its state is kept in {kept.parent if folds and kept else kept}")
        # written out from the options, not from sys.argv: torchrun has put words of its own before
        # them
        command = _resume_command(
            spec, data_root, settings, engine, device, out, folds=folds, tensorboard=tensorboard
        )
        if ranks is not None:
            command = f"torchrun --nproc-per-node {ranks.count} -m {command}"
        note(f"this goes on: {command}")
        raise typer.Exit(ExitCode.INTERRUPTED) from None
    finally:
        # of a training that was interrupted behind its last stage too
        report(lines.at_end, model.sources)
    record = training_record(model.program, found.weights, progress, found.standard_errors)
    if format is ResultFormat.JSON:
        json_result("train", {**record, "folder": str(found.folder)})
        return
    result(stages_table(progress.stages))
    result("")
    result(parameters_table(record))
    for said in (errors_note(record), zeros_note(record)):
        if said is not None:
            result(said)
    result("")
    result(f"kept in {found.folder}")


def _show_folds(found: FoldsResult, format: ResultFormat) -> None:
    from msnn.cli.console import json_result, result
    from msnn.training.folds import folds_record, folds_table

    if format is ResultFormat.JSON:
        json_result("train", {**folds_record(found), "folder": str(found.folder)})
        return
    result(folds_table(found))
    result("")
    result(f"kept in {found.folder}; `latest` leads to fold {found.best.number}")


def _resume_command(
    spec: Path,
    data_root: Path | None,
    settings: list[str] | None,
    engine: EngineName | None,
    device: str,
    out: Path,
    *,
    folds: bool,
    tensorboard: bool,
) -> str:
    """The shell command that continues the training with these options; options with default values
    are left out.
    """
    words = ["msnn", "train", str(spec), "--resume"]
    words += [] if data_root is None else ["--data-root", str(data_root)]
    words += [word for setting in settings or () for word in ("--set", setting)]
    words += [] if engine is None else ["--engine", engine.value]
    # defaults are left out: the line stays as short as one that a person would write
    words += [] if device == "cpu" else ["--device", device]
    words += ["--folds"] if folds else []
    words += ["--tensorboard"] if tensorboard else []
    words += [] if out == RUNS else ["--out", str(out)]
    return shlex.join(words)

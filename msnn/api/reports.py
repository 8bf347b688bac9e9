"""Writes the report of a run: one page with plots, tables, formulas and a live model."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from compiler.passes.close_loop import LoopError
from msnn.errors.learning.runs import no_run
from msnn.model.model_data import sources_of
from msnn.model.saved_run import run_of
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError
from spec_schema.errors.plugins import OTHER_VERSION

if TYPE_CHECKING:
    from msnn.data.dataset import Dataset
    from msnn.data.reading.frames import Frames
    from msnn.model.model import Model
    from msnn.model.model_weights import ChosenWeights
    from msnn.reports.run_summary import Run
    from msnn.simulation.engines.engine import RolloutProgress
    from msnn.simulation.simulate import Simulation
    from msnn.training.records.run_log import RunLine
    from msnn.validation.validate import ValidationReport

PAGE = "report.html"


@dataclass(frozen=True, slots=True)
class WrittenReport:
    """The page, and warnings about missing contents."""

    path: Path
    warnings: tuple[Diagnostic, ...]
    is_live: bool
    """True if the model runs in the page."""


def report(
    run: str | Path,
    file: str | Path | None = None,
    *,
    data: Frames | None = None,
    data_root: str | Path | None = None,
    engine: str = "auto",
    verification: str | Path | None = None,
    progress: RolloutProgress | None = None,
) -> WrittenReport:
    """Writes a run as one self-contained HTML page, by default `report.html` in the run.

        written = msnn.report("runs/plant/latest", "plant.html")
        print(written.path, written.warnings)
        msnn.report("runs/plant/latest", data=frames)  # of a run that was trained on frames

    `data` is as in `train`; None means the data of the spec, below `data_root`. Without data the
    page shows no recordings; data other than those of the training are marked. `engine` is as in
    `validate`. `verification` is an output file of `msnn verify --format json`. Without the extra
    `zig` the page has no live model. Raises SpecError for a folder that is not a run, and for a run
    without weights.
    """
    from backends.files.atomic_write import write_text
    from msnn.errors import validation as errors
    from msnn.features.report_page.live import NotLive, live_model
    from msnn.features.report_page.page import Contents, page_text
    from msnn.model.load import load_model
    from msnn.model.model_weights import choose_weights
    from msnn.reports.drawn import shown_first
    from msnn.reports.learned_functions import learned_functions
    from msnn.reports.run_summary import read_run

    if (folder := run_of(Path(run))) is None:
        raise SpecError([no_run(str(run), ())])
    found = read_run(folder)
    model = load_model(found.folder)
    checks = None if verification is None else _verification(Path(verification))
    chosen = choose_weights(model, None, found.folder.parent)
    warnings: list[Diagnostic] = []
    dataset, simulations, validation = _measured(
        model, chosen, data, data_root, engine, progress, warnings
    )
    if dataset is not None and _are_others(dataset, found):
        warnings.append(_other_data(were_given=data is not None))
    live = live_model(model, chosen.weights, dataset, shown_first(simulations))
    if isinstance(live, NotLive):
        warnings.append(errors.no_part("running model", live.reason, live.repair))
    with sources_of(model):
        functions = learned_functions(model, chosen.weights, dataset)
    text = page_text(
        Contents(
            run=found,
            model=model,
            weights=chosen.weights,
            data=dataset,
            simulations=simulations,
            validation=validation,
            functions=functions,
            live=live,
            line=_line(found.folder),
            verification=checks,
            left_out=[*(warning.message for warning in warnings), *_undrawn(model)],
        )
    )
    path = found.folder / PAGE if file is None else Path(file)
    changed = [warning for warning in model.warnings if warning.code == OTHER_VERSION]
    said = (*changed, *warnings)
    return WrittenReport(write_text(path, text), said, not isinstance(live, NotLive))


def _other_data(*, were_given: bool) -> Diagnostic:
    from msnn.errors import validation as errors

    if were_given:
        kept = "those that were given are others; records and errors are of these"
        return errors.no_part("data of the training", kept)
    reason = "the files are others now, or it was given its data in memory"
    kept = f"{reason}; records and errors are of the files as is"
    repair = "data of a session can be handed over, in Python: `msnn.report(run, data=frames)`"
    return errors.no_part("data of the training", kept, repair)


def _are_others(data: Dataset, run: Run) -> bool:
    """True if the run was trained on other data; False if this is unknown."""
    from msnn.training.records.run_record import data_hash

    trained_on = run.description["data"].get("sha256")
    return trained_on is not None and trained_on != data_hash(data)


def _undrawn(model: Model) -> list[str]:
    if not model.read.used:
        return []
    return ["Of a model with sub-models only taps are drawn of what was learned."]


def _measured(
    model: Model,
    chosen: ChosenWeights,
    frames: Frames | None,
    data_root: str | Path | None,
    engine: str,
    progress: RolloutProgress | None,
    warnings: list[Diagnostic],
) -> tuple[Dataset | None, tuple[Simulation, ...], ValidationReport | None]:
    """The data, simulations and metrics; each is empty if it is not available."""
    from msnn.api.measurements import needs_data, validate_on
    from msnn.errors import validation as errors
    from msnn.exports.prepare import loop_fault
    from msnn.exports.running.exported_rollouts import chosen_engine
    from msnn.model.weights.kept_starts import known_starts
    from msnn.simulation.engines.engine import nobody
    from msnn.simulation.simulate import simulate, simulation_program

    runs: tuple[Simulation, ...] = ()
    validation: ValidationReport | None = None
    data = _read(model, frames, data_root, warnings)
    # entries with files of their own are measured all the same
    if data is None and needs_data(model):
        return data, runs, validation
    try:
        if data is not None:
            runs_by = chosen_engine(model, engine)
            program = simulation_program(model.program)
            with sources_of(model):
                found = simulate(
                    program,
                    data,
                    chosen.weights,
                    engine=runs_by,
                    progress=progress or nobody,
                    kept=known_starts(chosen.given, chosen.weights),
                )
            runs = found.runs
            warnings += found.warnings
    except LoopError as error:
        warnings.append(errors.no_part("records", loop_fault(error, None).message))
    except SpecError as error:
        first = error.diagnostics[0]
        warnings.append(errors.no_part("records", first.message, first.help))
    try:
        validation = validate_on(
            model, data, chosen.given, data_root=data_root, engine=engine, progress=progress
        )
        warnings += (warning for warning in validation.warnings if warning not in warnings)
    except SpecError as error:
        first = error.diagnostics[0]
        warnings.append(errors.no_part("errors", first.message, first.help))
    return data, runs, validation


def _read(
    model: Model, frames: Frames | None, data_root: str | Path | None, warnings: list[Diagnostic]
) -> Dataset | None:
    """The data of the caller or of the spec; None after a warning about the missing contents."""
    from msnn.api.measurements import needs_data
    from msnn.errors import validation as errors
    from msnn.model.model_data import measured

    lacking = "records and errors" if needs_data(model) else "records"
    if frames is None and model.spec.data is None:
        reason = (
            "the run was given its data in Python and does not keep them; its spec names no files"
        )
        repair = "hand them over again, in Python: `msnn.report(run, data=frames)`"
        warnings.append(errors.no_part(lacking, reason, repair))
        return None
    try:
        return measured(model, frames, data_root, "report")
    except SpecError as error:
        first = error.diagnostics[0]
        warnings.append(errors.no_part(lacking, first.message, first.help))
        return None


def _line(folder: Path) -> RunLine | None:
    """The line of the run in the log of trainings."""
    from msnn.training.records import run_log

    # a run lies in the folder of its model below the log, a fold in its run
    for above in folder.absolute().parents[:3]:
        lines = run_log.read(above / run_log.LOG)
        for line in reversed(lines):
            # resolved: `latest` is a link to the folder that the log names
            if line.folder is not None and (above / line.folder).resolve() == folder.resolve():
                return line
    return None


def _verification(file: Path) -> dict[str, Any]:
    """The output of `msnn verify --format json`; SpecError for any other file."""
    from msnn.errors import validation as errors
    from spec_schema.reading.reader import refuse_endless

    try:
        refuse_endless(file)
        found = json.loads(file.read_text(encoding="utf-8"))
        # all that the page reads, so that it need not look again
        _ = found["model"]
        for result in found["results"]:
            _ = result["check"], result["target"], result["detail"], result["verdict"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise SpecError([errors.not_verification(str(file))]) from error
    return found

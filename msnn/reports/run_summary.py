"""Reads the folder of a training run as untrusted input, and summarises it."""

from __future__ import annotations

import json
import math
import shlex
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, cast

from msnn.errors.learning.runs import unreadable_run
from msnn.model.program_file import plugins_text
from msnn.model.saved_run import (
    DESCRIPTION,
    FOLD,
    FOLD_SETTING,
    METRICS,
    PARAMETERS,
    SPEC,
    WEIGHTS,
    data_plugins,
    has_checkpoint,
    newest,
    read_json,
    recorded_plugins,
    run_of,
)
from msnn.reports.training_summary import (
    errors_note,
    parameters_table,
    stages_table,
    zeros_note,
)
from msnn.tables import count, table_text
from msnn.training.records.progress import EpochEnd, StageEnd, leading_epochs
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.reading.settings import model_settings
from spec_schema.version import __version__


@dataclass(frozen=True, slots=True)
class TrainedStage:
    """A stage that has begun: the leading attempt with all its epochs."""

    reached: StageEnd
    epochs: tuple[EpochEnd, ...]

    @property
    def losses(self) -> Mapping[str, float]:
        """The losses of the last epoch, on the training data."""
        return self.epochs[-1].losses


@dataclass(frozen=True, slots=True)
class Run:
    """The contents of a run's files."""

    folder: Path
    description: Mapping[str, Any]
    stages: tuple[TrainedStage, ...]
    parameters: Mapping[str, Any] | None
    """The record of `parameters_record`; None for an incomplete run."""

    @property
    def end(self) -> Mapping[str, Any]:
        """The record of the run's end: state, reasons of stages, warnings."""
        return self.description.get("end") or {}

    @property
    def state(self) -> str:
        """`finished`, `interrupted`, `diverged`, or a text if the end was not recorded."""
        return self.end.get("state", "not ended: it still runs, or was killed")


def read_run(folder: Path) -> Run:
    """The run in a folder. Raises SpecError for other folders and other versions."""
    folder = run_of(folder) or folder
    description = read_json(folder / DESCRIPTION)
    try:
        return _checked(folder, description)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise SpecError((unreadable_run(str(folder), _other_writer(description)),)) from error


def _other_writer(description: Mapping[str, Any]) -> str | None:
    """The version of msnn that wrote a run, if it is known and differs from this one."""
    match description.get("versions"):
        case {"msnn": str(version)} if version != __version__:
            return version
        case _:
            return None


def _checked(folder: Path, description: Mapping[str, Any]) -> Run:
    if description["format"] != 1:
        raise ValueError(description["format"])
    end: dict[str, Any] = description.get("end") or {}
    reasons: dict[str, str] = end.get("stages", {})
    attempts: dict[str, dict[int, list[EpochEnd]]] = {}
    for event in _epochs(folder / METRICS):
        attempts.setdefault(event.stage, {}).setdefault(event.attempt, []).append(event)
    file = folder / PARAMETERS
    parameters = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else None
    run = Run(
        folder,
        description,
        tuple(_stage(runs, str(reasons.get(name, ""))) for name, runs in attempts.items()),
        parameters,
    )
    run_text(run)  # whatever cannot be shown is not what this version wrote
    return run


def _epochs(metrics: Path) -> Iterator[EpochEnd]:
    if not metrics.is_file():
        return
    for line in metrics.read_text(encoding="utf-8").splitlines():
        found: dict[str, Any] = json.loads(line)
        found["losses"] = {name: _number(value) for name, value in found["losses"].items()}
        found |= {name: _number(found[name]) for name in ("total", "monitor", "best")}
        yield EpochEnd(**found)


def _number(value: float | None) -> float:
    """The number; null in JSON means NaN."""
    return math.nan if value is None else float(value)


def _stage(attempts: Mapping[int, list[EpochEnd]], reason: str) -> TrainedStage:
    epochs = leading_epochs(attempts.values())
    last = epochs[-1]
    reached = StageEnd(
        stage=last.stage,
        attempt=last.attempt,
        attempts=last.attempts,
        epochs=last.epoch,
        best=last.best,
        best_epoch=last.best_epoch,
        seconds=last.seconds,
        reason=reason or f"at epoch {last.epoch} of {last.epochs}",
    )
    return TrainedStage(reached, tuple(epochs))


def run_text(run: Run) -> str:
    """A text about a run: its configuration, results, and commands to continue."""
    parts = [_heading(run)]
    if run.stages:
        parts.append(stages_table([(stage.reached, stage.losses) for stage in run.stages]))
    if run.parameters is not None:
        notes = (errors_note(run.parameters), zeros_note(run.parameters))
        parts.append("\n".join(filter(None, (parameters_table(run.parameters), *notes))))
    parts.append("\n".join(run.end.get("warnings", [])))
    rows = [(what, command) for what, command in commands(run).items()]
    parts.append(table_text(("next", ""), rows) if rows else "")
    return "\n\n".join(part for part in parts if part)


def run_record(run: Run) -> dict[str, Any]:
    """The configuration and results of a run as a JSON object."""
    return {
        "folder": str(run.folder),
        "state": run.state,
        "run": dict(run.description),
        "stages": [{**asdict(stage.reached), "losses": dict(stage.losses)} for stage in run.stages],
        **(run.parameters or {}),
        "warnings": list(run.end.get("warnings", [])),
        "commands": commands(run),
    }


def commands(run: Run) -> dict[str, str]:
    """Shell commands that continue from the run."""
    spec = run.description.get("spec")
    if not isinstance(spec, str):
        spec = str(run.folder / SPEC)
    found: dict[str, list[str]] = {}
    # a run that was taken elsewhere is a model of its own, without the file that it was trained of
    is_here = Path(spec).is_file()
    if has_checkpoint(run.folder):
        is_fold = run.folder.name.startswith(FOLD)
        if is_here and (is_fold or newest(run.folder.parent, has_checkpoint) == run.folder):
            found["resume"] = ["msnn", "train", spec, "--resume", *_settings(run), *_options(run)]
        elif not is_fold:  # named by itself, and with it its settings
            found["resume"] = ["msnn", "train", str(run.folder), "--resume", *_options(run)]
    if (run.folder / WEIGHTS).is_file():
        weights = ["--weights", str(run.folder / WEIGHTS)]
        settings = model_settings(run.description.get("settings", ()))
        words = [word for text in settings for word in ("--set", text)]
        # of a fold, too: the file holds out another one
        is_whole = is_here and not run.folder.name.startswith(FOLD)
        model = [spec, *weights, *words] if is_whole else [str(run.folder)]
        found["validate"] = ["msnn", "validate", *model]
        found["export"] = ["msnn", "export", *model]
    return {what: shlex.join(words) for what, words in found.items()}


def _settings(run: Run) -> list[str]:
    given = run.description.get("settings", [])
    if run.folder.name.startswith(FOLD):
        # `--folds` goes through them
        given = [text for text in given if not text.startswith(FOLD_SETTING)]
    return [word for text in given for word in ("--set", text)]


def _options(run: Run) -> list[str]:
    """Further options of the run's command line, as far as they were saved."""
    is_fold = run.folder.name.startswith(FOLD)
    device = run.description.get("device", "cpu")
    words = [] if device == "cpu" else ["--device", device]
    words += ["--tensorboard"] if any(run.folder.glob("events.out.*")) else []
    words += ["--folds"] if is_fold else []
    kept = run.folder.absolute().parents[1 if is_fold else 0]
    if kept.name != run.description.get("program"):  # taken out of the folder of trainings
        return words
    out = run.folder.parents[2 if is_fold else 1]
    return words if out.absolute() == Path("runs").absolute() else [*words, "--out", str(out)]


def _heading(run: Run) -> str:
    found = run.description
    data = found["data"]
    rows = ", ".join(f"{name} {number}" for name, number in data["rows"].items())
    changed = "" if _is_unchanged(run) else "; the file has changed since"
    settings = "".join(f", --set {text}" for text in found.get("settings", []))
    stages = cast("list[dict[str, Any]]", found["stages"])
    places = sorted({stage.get("device", "cpu") for stage in stages})
    lines = [
        ("model", f"{found['program']}: {run.state}"),
        (
            "spec",
            f"{found.get('spec') or SPEC}{settings}, sha256 {found['spec_sha256'][:12]}{changed}",
        ),
        ("data", f"{count(len(data['files']), 'record')}, rows: {rows}"),
        ("trained with", ", ".join(f"{n} {v}" for n, v in found["versions"].items())),
        *([("plug-ins", plugins_text(plugins))] if (plugins := recorded_plugins(found)) else []),
        *([("data read by", plugins_text(plugins))] if (plugins := data_plugins(found)) else []),
        ("on", ", ".join(places)),
    ]
    return table_text(("run", str(run.folder)), lines)


def _is_unchanged(run: Run) -> bool:
    """True if the spec is unchanged since the training, as far as its file can be found."""
    spec = run.description.get("spec")
    try:
        now = Path(str(spec)).read_text(encoding="utf-8")
        return now == (run.folder / SPEC).read_text(encoding="utf-8")
    except (OSError, ValueError):
        return True

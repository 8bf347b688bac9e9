"""Finds the runs of a model, and the copy of the model in a run's folder."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, cast

from compiler.ir.program import UsedPlugin
from msnn.errors.learning.runs import no_run, nothing_kept
from msnn.model.model_files import kept_name
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError
from spec_schema.late_dataclass import dataclass
from spec_schema.reading.reader import refuse_endless

LATEST = "latest"
WEIGHTS = "weights.safetensors"
CHECKPOINT = "checkpoint.safetensors"
SPEC = "spec.msnn.yaml"
DESCRIPTION = "run.json"
PARAMETERS = "parameters.json"
METRICS = "metrics.jsonl"
PARTS = "parts"
FOLD = "fold_"
FOLD_SETTING = "data.split.fold="
RUNS_SHOWN = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class KeptSpec:
    """The spec and its files as a run saved them, with the paths that they had when the run
    began.
    """

    path: Path
    """Path of the spec: the original one if its folder exists here, else the copy in the run."""
    text: str
    texts: Mapping[str, str]
    """Saved texts of sub-models and of files of initial values, by path."""
    weights: Mapping[str, Path]
    """Saved weights files of sub-models, by full name."""
    settings: tuple[str, ...]
    sha256: str
    trained_in: str | None
    """The folder of the spec when the run began, if it does not exist here."""
    formats: Mapping[str, UsedPlugin | None]
    """The plug-in that read the data files of each suffix; None for formats of msnn."""
    plugins: Mapping[str, str]
    """The packages of the model's plug-ins, with their versions."""
    warnings: tuple[Diagnostic, ...]
    """Warnings about plug-ins that are installed in another version."""


def leads_to(path: Path) -> Path | None:
    """The target of a link or of a text file `latest`; None for other paths.

    A file `latest` replaces the link on systems that do not allow links.
    """
    if path.is_symlink():
        return path.readlink()
    if path.name == LATEST and path.is_file():
        # the file may be unrelated to msnn: an unreadable one has no target
        with suppress(OSError, UnicodeDecodeError):
            return Path(path.read_text(encoding="utf-8").strip())
    return None


def followed(path: Path) -> Path:
    """The run that `latest` currently points to; any other path unchanged."""
    target = leads_to(path)
    return path if target is None else path.parent / target


def run_of(path: Path) -> Path | None:
    """The folder of the run that a path means: a run's folder, or the spec in it; None for other
    files.

    Raises SpecError for a folder that is not a run.
    """
    # of other files nothing is followed: a spec may itself be a link
    path = followed(path) if path.is_dir() or path.name == LATEST else path
    if path.is_dir():
        if not (path / DESCRIPTION).is_file():
            inside = sorted(each.parent for each in path.glob(f"*/{DESCRIPTION}"))
            # `latest` would name one of the others again
            named = [str(each) for each in inside if not each.is_symlink()]
            raise SpecError((no_run(str(path), named[-RUNS_SHOWN:]),))
        return path
    return path.parent if path.name == SPEC and (path.parent / DESCRIPTION).is_file() else None


def is_kept(file: Path) -> bool:
    """True if msnn has written this file into the folder of a run."""
    if file.parent.name == PARTS:
        return (file.parent.parent / DESCRIPTION).is_file()
    named = (DESCRIPTION, SPEC, PARAMETERS, METRICS)
    is_named = file.name in named or file.suffix == Path(WEIGHTS).suffix
    return is_named and (file.parent / DESCRIPTION).is_file()


def kept_spec(run: Path) -> KeptSpec:
    """The model saved in a run, read as untrusted input. Raises SpecError if it is incomplete."""
    record = read_json(run / DESCRIPTION)
    warnings: tuple[Diagnostic, ...] = ()
    if "plugins" in record:
        from msnn.model.program_file import require_plugins

        warnings = require_plugins(recorded_plugins(record), str(run / DESCRIPTION))
    try:
        text = _text(run / SPEC)
        parts = cast("dict[str, dict[str, str]]", record.get("parts", {}))
        places = [str(place) for place in record.get("spec_places", [])]
        found = (run / place for place in places)
        # the spec's own folder where it is known: data and sub-models are named from there
        path = next((place for place in found if place.is_file()), run / SPEC)
        texts: dict[str, str] = {}
        weights: dict[str, Path] = {}
        for name, part in parts.items():
            file = run / PARTS / kept_name(name, part)
            seen = os.path.relpath(part["path"], Path(record["spec"]).parent)
            # by both: where the file stands as seen from here, and where it stood at the time
            texts[os.path.normpath(path.parent / seen)] = texts[part["path"]] = _text(file)
            weights[name] = file.with_name(f"{Path(name).name}.safetensors")
        settings = tuple(str(text) for text in record.get("settings", []))
        sha256 = str(record["spec_sha256"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise SpecError((nothing_kept(str(run)),)) from error
    # runs of before places were kept do not say where they were trained
    is_gone = bool(places) and path == run / SPEC
    trained_in = str(Path(places[-1]).parent) if is_gone else None
    return KeptSpec(
        path=Path(os.path.normpath(path)),
        text=text,
        texts=texts,
        weights=weights,
        settings=settings,
        sha256=sha256,
        trained_in=trained_in,
        formats=recorded_formats(record),
        plugins=recorded_plugins(record),
        warnings=warnings,
    )


def spec_places(spec: str, run: Path) -> list[str]:
    """The path of the spec relative to the run, and its absolute path.

    The relative path stays valid when the whole project is moved. It is omitted if the spec is on
    another drive than the run.
    """
    absolute = str(Path(spec).absolute())
    try:
        seen = Path(os.path.relpath(absolute, os.path.realpath(run))).as_posix()
    except ValueError:  # on another drive
        return [absolute]
    return [seen, absolute]


def newest(runs: Path, wanted: Callable[[Path], bool]) -> Path | None:
    """The newest run in a folder that satisfies the predicate; None if there is none."""
    # `latest` is not a run of its own
    folders = [path for path in runs.glob("*") if path.is_dir() and not path.is_symlink()]
    return max(filter(wanted, folders), key=age, default=None)


def has_checkpoint(run: Path) -> bool:
    """True if a run was interrupted or is still running: its folder has a checkpoint."""
    return (run / CHECKPOINT).is_file()


def age(run: Path) -> tuple[str, int]:
    """Sort key of a run: the time in its folder's name, and its counter within that second."""
    day, _, time = run.name.partition("_")
    time, _, number = time.partition("_")
    # as a number: the tenth run of a second is later than the second
    return f"{day}_{time}", int(number) if number.isdecimal() else 1


def read_json(file: Path) -> dict[str, Any]:
    """The JSON object in a file; empty if the file cannot be read."""
    try:
        found = json.loads(_text(file))
    except (OSError, ValueError):
        return {}
    return cast("dict[str, Any]", found) if isinstance(found, dict) else {}


def recorded_plugins(record: Mapping[str, Any]) -> dict[str, str]:
    """The packages of the model's plug-ins in `run.json`, with their versions; untrusted input."""
    plugins = record.get("plugins")
    items = cast("dict[str, Any]", plugins).items() if isinstance(plugins, dict) else ()
    return {package: str(version) for package, version in items}


def recorded_formats(record: Mapping[str, Any]) -> dict[str, UsedPlugin | None]:
    """By suffix of the data files in `run.json`: the plug-in that read them, None for our formats.

    The record is untrusted input.
    """
    data = record.get("data")
    data = cast("dict[str, object]", data) if isinstance(data, dict) else {}
    files, plugins = data.get("files"), data.get("plugins")
    names = cast("list[object]", files) if isinstance(files, list) else []
    found: dict[str, UsedPlugin | None] = {
        Path(name).suffix.lower(): None for name in names if isinstance(name, str)
    }
    items = cast("dict[str, object]", plugins).items() if isinstance(plugins, dict) else ()
    for suffix, plugin in items:
        match plugin:
            case {"package": str(package), "version": str(version)}:
                found[suffix] = UsedPlugin(package, version)
            case _:
                pass
    return found


def data_plugins(record: Mapping[str, Any]) -> dict[str, str]:
    """The packages of the plug-ins in `run.json` that read the data, with their versions."""
    found = filter(None, recorded_formats(record).values())
    return {plugin.package: plugin.version for plugin in found}


def _text(file: Path) -> str:
    refuse_endless(file)
    return file.read_text(encoding="utf-8")

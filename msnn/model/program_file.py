"""Writes and reads the file of `msnn compile`: a program and the spec that it was compiled from."""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from backends.files.atomic_write import write_text
from compiler.elaboration.compile import compile_spec
from compiler.ir.program import UsedPlugin
from compiler.linking.link import link
from compiler.program_file.file import (
    data_from_json,
    data_to_json,
    program_from_data,
    program_to_data,
)
from msnn.errors.commands import foreign_spec, no_program_name
from msnn.errors.failures import MissingPluginError
from msnn.model.model import PROGRAM_SUFFIX, Model
from msnn.model.model_files import hash_of, number_parts, number_texts, parts_of
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings, SpecError
from spec_schema.errors.files import unreadable_file
from spec_schema.errors.plugins import other_version
from spec_schema.errors.settings import compiled_already
from spec_schema.plugins import look_up, plugins_with
from spec_schema.reading.reader import read_spec, refuse_endless
from spec_schema.reading.settings import model_settings, settings_source


def program_place(model: Model, out: Path) -> Path:
    """The path of a model's program file: in the folder `out`, or `out` itself if it names a file.

    Raises SpecError for a `.json` name that other commands would not recognise as a program file.
    """
    file = out / f"{model.name}{PROGRAM_SUFFIX}"
    # any other name is a folder that may not be there yet
    if out.suffix == ".json" and not out.is_dir():
        if not out.name.endswith(PROGRAM_SUFFIX):
            meant = out.with_name(out.stem + PROGRAM_SUFFIX)
            raise SpecError([no_program_name(str(out), str(meant))])
        file = out
    return file


def write_program_file(model: Model, out: Path) -> Path:
    """Writes `<name>.program.json`: the program, and the spec's text for its workflow sections.

    The file includes the texts of sub-models; their weights are already in the program. Returns the
    path and raises SpecError like `program_place`.
    """
    file = program_place(model, out)
    folder = file.parent
    spec: dict[str, Any] = {"path": _seen_from(folder, model.path), "text": model.text}
    if model.settings:
        spec["settings"] = list(model.settings)
    if model.parts:
        texts = {part.path: part.text for part in model.parts}
        spec["texts"] = {_seen_from(folder, path): text for path, text in texts.items()}
        # a file of numbers may be named by its whole path, and then is so on any machine
        named = {p.path: p.text for p in model.parts if p.is_numbers and Path(p.path).is_absolute()}
        spec["texts"] |= named
        # digests: the arrays are in the program
        spec["weights"] = {part.name: part.weights for part in model.parts if part.weights}
    return write_text(file, data_to_json(program_to_data(model.program) | {"spec": spec}))


def read_program_file(file: Path, settings: Sequence[str]) -> Model:
    """Reads a program file; the program is used as saved, other sections come from the spec's text.

    Raises SpecError if the file is not a program file or if its spec does not match the program.
    """
    shown = str(file)
    try:
        refuse_endless(file)
        text = file.read_text(encoding="utf-8")
    except OSError as error:
        raise SpecError([unreadable_file(shown, (error.strerror or str(error)).lower())]) from error
    except UnicodeDecodeError as error:
        raise SpecError([unreadable_file(shown, "it is not UTF-8 text")]) from error
    data = data_from_json(text, shown)
    # settings may change the training, but not the compiled model
    if refused := model_settings(settings):
        source = settings_source(refused)
        path = refused[0].partition("=")[0]
        raise SpecError([compiled_already(path, source.span(0, len(path)))], (source,))
    embedded = _embedded_spec(data, file.parent)
    program = program_from_data(data, shown)
    others = require_plugins({each.package: each.version for each in program.plugins}, shown)
    if embedded is None:
        raise SpecError([foreign_spec(shown)])
    own = embedded.settings
    settings = (*own, *settings)
    recorded = {each.package: each.version for each in program.plugins}
    everything = (embedded.text, *embedded.texts.values(), *settings)
    # layers and functions are those of the file
    kinds = ("section", "target")
    refuse_other_packages(recorded, shown, texts=everything, kinds=kinds)
    try:
        read = read_spec(embedded.path, embedded.text, settings, texts=embedded.texts)
    except SpecError:
        refuse_other_packages(recorded, shown, texts=everything)
        raise
    numbers = number_texts(read, embedded.texts)
    parts, text = (*parts_of(read, embedded.weights), *number_parts(numbers)), read.source.text
    if (
        # a program beside another spec would be trained and judged by wrong sections
        program.spec_hash != hash_of(text, parts, model_settings(own))
        or program.name != read.spec.name.value
    ):
        raise SpecError([foreign_spec(shown)])
    sources = (*read.sources, settings_source(settings))
    spec = link(
        read.spec, read.used, {}, Findings()
    ).spec  # which compiled when the file was written
    compiled, warnings = None, read.warnings
    if any(spec.sections()):
        # the program is that of the file, and only these are compiled here
        warnings += others
        hashed = program.spec_hash
        compiled = compile_spec(read.spec, used=read.used, numbers=numbers, spec_hash=hashed)
    return Model(
        program=program,
        spec=spec,
        problems={} if compiled is None else compiled.problems,
        path=embedded.path,
        text=text,
        sources=sources,
        warnings=warnings,
        read=read,
        parts=parts,
        settings=settings,
    )


def _seen_from(folder: Path, path: str | Path) -> str:
    return Path(os.path.relpath(path, folder)).as_posix()


@dataclass(frozen=True, slots=True, kw_only=True)
class _EmbeddedSpec:
    """The spec in a program file, with the texts of sub-models by path and the hashes of their
    weights.

    `settings` are the values that were overridden before compiling.
    """

    path: Path
    text: str
    texts: Mapping[str, str]
    weights: Mapping[str, str]
    settings: tuple[str, ...]


def _embedded_spec(data: Any, folder: Path) -> _EmbeddedSpec | None:
    """Removes the spec from the data of a program file and returns it; None if it is missing."""
    found = cast("dict[str, Any]", data).pop("spec", None) if isinstance(data, dict) else None
    match found:
        # no system can open a path with a null byte
        case {"path": str(path), "text": str(text)} if "\0" not in path:
            spec = Path(os.path.normpath(folder / path))
        case _:
            return None
    texts, weights = _texts(found.get("texts")), _texts(found.get("weights"))
    texts = {os.path.normpath(folder / path): text for path, text in texts.items()}
    listed = found.get("settings")
    given = cast("list[Any]", listed) if isinstance(listed, list) else []
    settings = tuple(one for one in given if isinstance(one, str))
    return _EmbeddedSpec(path=spec, text=text, texts=texts, weights=weights, settings=settings)


def _texts(data: Any) -> dict[str, str]:
    """The string values of a JSON object from an untrusted file; other values are dropped."""
    items = cast("dict[str, Any]", data).items() if isinstance(data, dict) else ()
    return {name: text for name, text in items if isinstance(text, str) and "\0" not in name}


def require_plugins(versions: Mapping[str, str], file: str) -> tuple[Diagnostic, ...]:
    """Warnings (W0956) about plug-ins that are installed in another version than a file names.

    Raises MissingPluginError for the first package, by name, that is not installed or fails.
    """
    if not versions:
        return ()
    plugins = look_up()
    installed = {plugin.package: plugin.version for plugin in plugins.found}
    for package, version in sorted(versions.items()):
        if package not in installed:
            raise MissingPluginError(package, version, file, plugins.failed.get(package, ""))
    return tuple(
        other_version(f"{file} was made", package, version, installed[package])
        for package, version in sorted(versions.items())
        if version != installed[package]
    )


def refuse_other_packages(
    versions: Mapping[str, str],
    file: str,
    *,
    now: Iterable[UsedPlugin] | None = None,
    texts: Iterable[str] = (),
    kinds: Collection[str] = ("section", "target", "layer", "function"),
) -> None:
    """Refuses a model of which another package has a name than when a file was made.

    `versions` are the plug-ins that the file names. `now` are those that the compiled model uses,
    None if it is not compiled. If there are `texts` of the spec, only names in them count. Raises
    MissingPluginError for the first such name.
    """
    if not versions:
        return
    plugins, used, texts = look_up(), None if now is None else tuple(now), tuple(texts)
    for (kind, key), packages in sorted(plugins.taken.items()):
        then = next((package for package in packages if package in versions), None)
        owner = next(iter(plugins_with([(kind, key)])))
        is_used = used is None or any(each.package == owner.package for each in used)
        if kind not in kinds or then is None or owner.package in versions or not is_used:
            continue
        if texts and not any(re.search(rf"\b{re.escape(key)}\b", text) for text in texts):
            continue
        reason = f"the package {owner.package} {owner.version} has the {kind} `{key}` now"
        raise _other_package(then, versions[then], file, reason, owner.package)
    if used is None:
        return
    gone = sorted(versions.keys() - {each.package for each in used})
    new = [each for each in used if each.package not in versions]
    if gone and new:
        reason = f"the package {new[0].package} {new[0].version} takes its place now"
        raise _other_package(gone[0], versions[gone[0]], file, reason, new[0].package)


def _other_package(
    package: str, version: str, file: str, reason: str, other: str
) -> MissingPluginError:
    repair = f"remove {other}, or make the file again with it"
    return MissingPluginError(package, version, file, reason, repair)


def plugins_text(versions: Mapping[str, str]) -> str:
    """A text with each plug-in and its version, and the installed version if it is another."""
    if not versions:
        return ""
    plugins = look_up()
    installed = {plugin.package: plugin.version for plugin in plugins.found}
    return ", ".join(
        f"{package} {version}{_difference(package, version, installed, plugins.failed)}"
        for package, version in versions.items()
    )


def _difference(
    package: str, version: str, installed: Mapping[str, str], failed: Mapping[str, str]
) -> str:
    if package in failed:
        return f" (it fails: {failed[package]})"
    if package not in installed:
        return f" (not installed: pip install {package})"
    now = installed[package]
    return "" if now == version else f" ({now} is installed)"

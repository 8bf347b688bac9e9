"""Loads a model from the file of a command, and the weights of its sub-models, untrusted input."""

from __future__ import annotations

import hashlib
import json
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from compiler.elaboration.compile import compile_spec
from msnn.data.dataset import FloatArray
from msnn.errors.learning.runs import nothing_kept
from msnn.model.model import PROGRAM_SUFFIX, Model
from msnn.model.model_files import hash_of, number_parts, number_texts, parts_of, with_files
from msnn.model.saved_run import DESCRIPTION, LATEST, KeptSpec, kept_spec, run_of
from msnn.model.weights.safetensors_file import WeightsFault, arrays_in
from spec_schema.diagnostics.diagnostic import Findings, SpecError
from spec_schema.errors import submodels as errors
from spec_schema.late_dataclass import dataclass
from spec_schema.reading.reader import ReadResult, read_spec, refuse_endless
from spec_schema.reading.settings import model_settings, settings_source
from spec_schema.sections.submodels import Use


def load_model(
    path: str | Path,
    settings: Sequence[str] = (),
    *,
    strict_units: bool = False,
    text: str | None = None,
    unsaved: Mapping[str, str] | None = None,
) -> Model:
    """Loads a spec (`.yaml`, `.json`), a program file (`….program.json`) or the folder of a run.

    `text` is used as the content of the spec at `path`, which is then not read. `unsaved` maps real
    paths of other specs to texts that replace their files, as an editor has them. `settings` such
    as `train.0.epochs=5` override values of the spec. `strict_units` turns warnings about units
    into errors. Raises SpecError with all errors found.
    """
    path = Path(path)
    # the text of an editor takes precedence, even in the folder of a run
    run = run_of(path) if text is None else None
    if run is not None:
        return _of_run(run, settings, strict_units)
    if text is None and path.name.endswith(PROGRAM_SUFFIX):
        from msnn.model.program_file import read_program_file  # models of specs start without it

        return read_program_file(path, settings)
    read = read_spec(path, text, settings, unsaved=unsaved)
    model = _compiled(read, path, settings, strict_units)
    return replace(model, settings=tuple(settings))


def with_engine(model: Model, engine: Literal["auto", "native", "torch"]) -> Model:
    """The model with every stage trained by this engine."""
    stages = tuple(stage.model_copy(update={"engine": engine}) for stage in model.spec.train)
    spec = model.spec.model_copy(update={"train": stages})
    # as settings too: a run keeps these, and has to repeat what was trained
    same = (f"train.{number}.engine={engine}" for number in range(len(stages)))
    return replace(model, spec=spec, settings=(*model.settings, *same))


def with_seed(model: Model, seed: int) -> Model:
    """The model with `seed` added to the seed of every stage."""
    # nothing is set then: such a run has the hash and settings of a plain one
    if not seed:
        return model
    stages = tuple(
        stage.model_copy(update={"seed": stage.seed + seed}) for stage in model.spec.train
    )
    spec = model.spec.model_copy(update={"train": stages})
    same = (f"train.{number}.seed={stage.seed}" for number, stage in enumerate(stages))
    return replace(model, spec=spec, settings=(*model.settings, *same))


def _of_run(run: Path, settings: Sequence[str], strict_units: bool) -> Model:
    """The model saved in a run; settings of the run apply first, then `settings`."""
    kept = kept_spec(run)
    # those given here come last, so that they win
    settings = (*kept.settings, *settings)
    texts = (kept.text, *kept.texts.values(), *settings)
    try:
        read = read_spec(kept.path, kept.text, settings, texts=kept.texts)
        model = _compiled(read, kept.path, settings, strict_units, kept)
    except SpecError:
        _refuse_other_packages(kept, run, None, texts)
        raise
    _refuse_other_packages(kept, run, model, texts)
    # with the run's own settings: those given here may change training, never what was kept
    if hash_of(model.text, model.parts, model_settings(kept.settings)) != kept.sha256:
        raise SpecError((nothing_kept(str(run)),))
    return replace(
        model,
        settings=settings,
        run=run,
        trained_in=kept.trained_in,
        recorded=kept.formats,
        warnings=(*kept.warnings, *model.warnings),
    )


def _refuse_other_packages(
    kept: KeptSpec, run: Path, model: Model | None, texts: Sequence[str]
) -> None:
    if not kept.plugins:
        return
    from msnn.model.program_file import refuse_other_packages

    now = None if model is None else model.program.plugins
    refuse_other_packages(kept.plugins, str(run / DESCRIPTION), now=now, texts=texts)


def _compiled(
    read: ReadResult,
    path: Path,
    settings: Sequence[str],
    strict_units: bool,
    kept: KeptSpec | None = None,
) -> Model:
    sources = (*read.sources, settings_source(settings))
    text, findings = read.source.text, Findings()
    # first, so that lines are told in the order of the file
    findings.report(*read.warnings)
    texts = None if kept is None else kept.texts
    weights = read_submodel_weights(read, findings, None if kept is None else kept.weights, texts)
    numbers = number_texts(read, texts)
    # after the weights: their digests are part of the model's hash
    specs = with_files(parts_of(read, weights.digests), weights.files)
    parts = (*specs, *number_parts(numbers))
    try:
        # weights that cannot be used would compile as if there were none
        findings.raise_errors()
        compiled = compile_spec(
            read.spec,
            used=read.used,
            weights=weights.arrays,
            numbers=numbers,
            strict_units=strict_units,
            spec_hash=hash_of(text, parts, model_settings(settings)),
        )
    except SpecError as error:
        # with the warnings before: they often are the reason
        findings.report(*error.diagnostics)
        raise SpecError(findings.in_order, sources) from None
    said = (*findings.in_order, *compiled.warnings)
    return Model(
        program=compiled.program,
        spec=compiled.spec,
        path=path,
        text=text,
        sources=sources,
        warnings=tuple(found for found in said if found.severity == "warning"),
        problems=compiled.problems,
        types=compiled.types,
        remarks=tuple(found for found in said if found.severity == "note"),
        read=read,
        parts=parts,
        part_weights=weights.arrays,
    )


LARGEST_FILE = 1 << 30
"""Maximum size of a weights file in bytes."""


@dataclass(frozen=True)
class SubmodelWeights:
    """The trained arrays of sub-models with `weights:`, and the SHA-256 of the files that they come
    from.
    """

    arrays: dict[str, Mapping[str, FloatArray]] = field(
        default_factory=dict[str, Mapping[str, FloatArray]]
    )
    digests: dict[str, str] = field(default_factory=dict[str, str])
    files: dict[str, Path] = field(default_factory=dict[str, Path])


def read_submodel_weights(
    read: ReadResult,
    findings: Findings,
    kept: Mapping[str, Path] | None = None,
    texts: Mapping[str, str] | None = None,
) -> SubmodelWeights:
    """Reads the `weights:` files of a spec's sub-models, including nested ones.

    `kept` maps full names of sub-models to saved copies of these files. `texts` are the saved texts
    of files of initial values.
    """
    found = SubmodelWeights()
    for name, use, file, parent in _uses(read, ""):
        if use.weights is not None:
            path = Path(parent.source.path).parent / use.weights.value
            path = path if kept is None else kept[name]
            _read(name, use, _File(file, path, texts), found, findings)
    return found


def _uses(read: ReadResult, prefix: str) -> Iterator[tuple[str, Use, ReadResult, ReadResult]]:
    """Yields full name, use, its file and the file that uses it; nested sub-models first."""
    for name, use in read.spec.use.items():
        file = read.used[name]
        # inner ones first: the hash that an outer file was written for counts their digests
        yield from _uses(file, f"{prefix}{name}.")
        yield prefix + name, use, file, read


@dataclass(frozen=True, slots=True)
class _File:
    """A sub-model's spec, its weights file, and saved texts of files of initial values."""

    spec: ReadResult
    weights: Path
    texts: Mapping[str, str] | None


def _read(name: str, use: Use, of: _File, found: SubmodelWeights, findings: Findings) -> None:
    assert use.weights is not None
    place, file, path = use.weights.span, of.spec, of.weights
    try:
        content = _content(path)
    except (OSError, ValueError) as error:
        reason = (getattr(error, "strerror", None) or str(error)).lower()
        command = f"msnn train {file.source.path}{_where(path)}"
        repair = f"train it first: `{command}`, or leave `weights:` out"
        problem = f"cannot read {path}: {reason}"
        findings.report(errors.unusable_weights(name, problem, place, repair))
        return
    try:
        arrays = arrays_in(content)
    except WeightsFault as fault:
        problem = f"cannot read {path}: {fault}"
        findings.report(errors.unusable_weights(name, problem, place, None))
        return
    # of the very bytes that were read: the file may change meanwhile
    found.digests[name] = hashlib.sha256(content).hexdigest()
    found.files[name] = path
    found.arrays[name] = {
        array: values.astype(np.float64)
        for array, values in arrays.items()
        if np.issubdtype(values.dtype, np.floating)
    }
    # every array is told of, not the first alone
    for array, values in arrays.items():
        problem = None
        if array not in found.arrays[name]:
            problem = f"`{array}` holds {values.dtype} values, not floating point numbers"
        elif not np.all(np.isfinite(values)):
            problem = f"`{array}` has values that are not finite"
        if problem is not None:
            findings.report(errors.unusable_weights(name, problem, place, None))
    written_for = _metadata(content).get("spec_sha256")
    inner = {
        inner.removeprefix(f"{name}."): digest
        for inner, digest in found.digests.items()
        if inner.startswith(f"{name}.")
    }
    parts = (*parts_of(file, inner), *number_parts(number_texts(file, of.texts)))
    if written_for in (None, hash_of(file.source.text, parts)):
        return
    from msnn.model.trained_model import is_of_this_model  # only texts that differ need it

    if not is_of_this_model(file, parts, path):
        findings.report(errors.weights_of_other_text(name, use.file.value, place))


def _where(weights: Path) -> str:
    """The option `--out` with which a training saves its weights as `OUT/NAME/latest`; else
    empty.
    """
    above = weights.parents
    if len(above) < 4 or above[0].name != LATEST or above[2] == Path("runs"):
        return ""
    return f" --out {shlex.quote(str(above[2]))}"


def _content(path: Path) -> bytes:
    """The bytes of a regular file, such as weights.

    Raises ValueError for a device, a pipe or a too large file.
    """
    if not path.exists():
        message = "no such file"
        raise ValueError(message)
    # a pipe would wait for ever
    if not path.is_file() or path.stat().st_size > LARGEST_FILE:
        message = "it is not a file of weights"
        raise ValueError(message)
    refuse_endless(path)
    return path.read_bytes()


def _metadata(content: bytes) -> Mapping[str, Any]:
    """The metadata of a safetensors header, whose length and JSON syntax `load` has checked."""
    length = int.from_bytes(content[:8], "little")
    header: dict[str, Any] = json.loads(content[8 : 8 + length])
    return header.get("__metadata__", {})

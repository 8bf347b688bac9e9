"""Loads a model from the file of a command: a spec, or what `msnn compile` wrote."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

from compiler.elaboration.compile import compile_spec
from msnn.errors.learning.run_ends import nothing_kept
from msnn.model.model import PROGRAM_SUFFIX, Model
from msnn.model.number_files import number_parts, number_texts
from msnn.model.saved_run import KeptSpec, kept_spec, run_of
from msnn.model.spec_hash import hash_of, parts_of, with_files
from msnn.model.submodel_weights import read_submodel_weights
from spec_schema.diagnostics.diagnostic import Findings, SpecError
from spec_schema.reading.reader import ReadResult, read_spec
from spec_schema.reading.settings import model_settings, settings_source


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
    read = read_spec(kept.path, kept.text, settings, texts=kept.texts)
    model = _compiled(read, kept.path, settings, strict_units, kept)
    # with the run's own settings: those given here may change training, never what was kept
    if hash_of(model.text, model.parts, model_settings(kept.settings)) != kept.sha256:
        raise SpecError((nothing_kept(str(run)),))
    return replace(model, settings=settings, run=run, trained_in=kept.trained_in)


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

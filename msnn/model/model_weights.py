"""Chooses the weights of a command: a given file, the last training's, or the initial ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from compiler.elaboration.compile import compile_spec
from msnn.data.dataset import FloatArray
from msnn.errors.commands import not_trained
from msnn.errors.learning.runs import unfinished_run
from msnn.model.model import Model
from msnn.model.saved_run import (
    FOLD,
    LATEST,
    WEIGHTS,
    age,
    followed,
    has_checkpoint,
    newest,
)
from msnn.model.trained_model import refuse_other_model
from msnn.model.weights.weights_file import (
    changed_plugins,
    initial_weights,
    known_weights,
    read_weights,
    refuse_taken_names,
)
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError
from spec_schema.errors.plugins import other_version


@dataclass(frozen=True, slots=True)
class ChosenWeights:
    """The weights that a command uses, and a text about their origin."""

    weights: Mapping[str, FloatArray]
    origin: str
    warnings: tuple[Diagnostic, ...] = ()
    file: Path | None = None
    """The file they were read from; None for the initial values."""

    @property
    def given(self) -> Mapping[str, FloatArray] | Path:
        """The weights file if there is one, else the values; a run keeps related files next to its
        weights file.
        """
        return self.weights if self.file is None else self.file


def redrawn_weights(model: Model, draw: int) -> dict[str, FloatArray]:
    """The initial values of random draw number `draw`, by parameter.

    Sub-models with `weights:` keep their trained values.
    """
    read = model.read
    numbers = {part.path: part.text for part in model.parts if part.is_numbers}
    program = compile_spec(
        read.spec, used=read.used, weights=model.part_weights, numbers=numbers, draw=draw
    ).program
    # trained elsewhere: to draw these anew would throw that training away
    given = tuple(f"{part.name}." for part in model.parts if part.weights)
    kept = initial_weights(model.program)
    return {
        name: kept[name] if name.startswith(given) else values
        for name, values in initial_weights(program).items()
    }


def choose_weights(
    model: Model, file: Path | None, runs: Path, *, initial: bool = False
) -> ChosenWeights:
    """The weights in `file`; else the initial ones if `initial`; else those of a training run.

    The training run is the one that the model was loaded from, else the latest in `runs`. Raises
    SpecError if a file does not fit the model, if its run trained another model, or if no training
    run exists.
    """
    program = model.program
    needs_training = any(p.learn or p.statistic is not None for p in program.parameters)
    # a given file takes precedence even if nothing is learned: it may hold other constants
    if file is None and (initial or not needs_training):
        return ChosenWeights(known_weights(program, None), _of_the_spec(model))
    warnings: tuple[Diagnostic, ...] = ()
    if file is None:
        # by the model's name: several share the folder of runs
        link = runs / program.name / LATEST
        latest = link if link.is_dir() else followed(link)
        # a command that names a run must not use a later one
        unfinished = None if model.run is not None else newest(link.parent, has_checkpoint)
        file = (latest if model.run is None else model.run) / WEIGHTS
        if not file.is_file():
            begun = None if unfinished is None else str(unfinished)
            raise SpecError([not_trained(str(file), program.name, begun)])
        if unfinished is not None and age(unfinished) > age(_whole_run(latest.resolve())):
            warnings = (unfinished_run(str(unfinished), str(latest.resolve().name)),)
    refuse_taken_names(file, program)
    refuse_other_model(model, file)
    if model.run is None or model.run.resolve() != file.parent.resolve():
        # a model of a run has these warnings already
        warnings += tuple(
            other_version(f"{file} was trained", now.package, then, now.version)
            for then, now in changed_plugins(file, program)
        )
    return ChosenWeights(read_weights(file, program), str(file), warnings, file)


def _of_the_spec(model: Model) -> str:
    """The description of initial weights, with the files of sub-models' weights."""
    given = [f"of `{part.name}` those in {part.file}" for part in model.parts if part.file]
    return ", ".join(("the initial values of the spec", *given))


def _whole_run(folder: Path) -> Path:
    """The run that a fold belongs to, or the run itself."""
    # a fold has no time in its name
    return folder.parent if folder.name.startswith(FOLD) else folder

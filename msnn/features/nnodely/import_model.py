"""Converts a model saved by nnodely 1.x to a spec and weights."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.files.atomic_write import write_text
from compiler.elaboration.compile import compile_spec
from compiler.ir.program import Program
from msnn.features.nnodely.errors import (
    copied,
    does_not_compile,
    file_exists,
    not_json,
    renamed,
    unfit_shapes,
    unknown_name,
    unknown_relation,
)
from msnn.features.nnodely.functions import Functions
from msnn.features.nnodely.json_text import JsonText, read_json
from msnn.features.nnodely.layers import Layers
from msnn.features.nnodely.names import Dims, TakenNames, legal_name
from msnn.features.nnodely.parameters import Parameters
from msnn.features.nnodely.recognition import recognise
from msnn.features.nnodely.relations import Relations
from msnn.features.nnodely.saved_model import (
    File,
    names_in,
    read_file,
    shared_across,
    shared_arrays,
)
from msnn.features.nnodely.signals import Loops, OtherLoopError, Signals
from msnn.features.nnodely.spec_sections import Equations, Sections, spec_values
from msnn.features.nnodely.terms import Cutter, Term
from msnn.features.nnodely.values import ShapeError, ValueOperations
from msnn.model.weights.weights_file import initial_weights, write_weights
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings, SpecError, describe
from spec_schema.editors.format_spec import format_spec
from spec_schema.reading.reader import read_spec, refuse_endless
from spec_schema.yaml_tree.writer import yaml_text

_MOST_PASSES = 8
"""Maximum repetitions, each of which finds a closed loop with more samples."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportedModel:
    """A spec as plain values, its weights by name of the parameter, and notes for the user."""

    spec: dict[str, Any]
    weights: dict[str, NDArray[np.float64]]
    names: dict[str, dict[str, str]]
    """Names of the file's inputs and outputs in the spec."""
    warnings: tuple[Diagnostic, ...]
    text: JsonText


def import_text(text: str, file_name: str, name: str) -> ImportedModel:
    """Converts the JSON text of a saved model to a spec with the name `name`. `file_name` is used
    in messages. Raises SpecError for errors and unsupported parts.
    """
    read = read_json(text, file_name)
    file = read_file(read)
    known = Loops()
    # each input can change twice: its width becomes known, and that its future is read
    for _ in range(_MOST_PASSES + 2 * len(file.Inputs)):
        try:
            return _Import(file, read, name, known).model()
        except OtherLoopError:
            continue
    raise SpecError([not_json(file_name, "its closed loops do not settle", "", None)])


def read_text(path: Path) -> str:
    """The text of a file in UTF-8. Raises SpecError if it cannot be read."""
    try:
        # a device or a pipe has no end
        refuse_endless(path)
        return path.read_bytes().decode("utf-8")
    except UnicodeDecodeError:
        reason = "it is no UTF-8 text"
    except OSError as fault:
        reason = (fault.strerror or str(fault)).lower()
    raise SpecError([not_json(str(path), reason, "", None)])


class _Import:
    def __init__(self, file: File, text: JsonText, name: str, known: Loops) -> None:
        self._file, self._text, self._name = file, text, name
        self._findings = Findings()
        self._names = TakenNames()
        for kind, olds in (("input", file.Inputs), ("output", file.Outputs)):
            for old in olds:
                # inputs and outputs first: what users call by name keeps its own where two want it
                self._names.of(kind, old)
        dims = Dims(self._names.free)
        self._parameters = Parameters(
            text=text,
            parameters=file.Parameters,
            constants=file.Constants,
            sample_time=float(file.Info.SampleTime),
            names=self._names,
            dims=dims,
            across=shared_across(file),
        )
        values = ValueOperations(dims, Cutter(self._parameters.samples, self._parameters.stacked))
        self._functions = Functions(
            file=file, text=text, names=self._names, parameters=self._parameters, values=values
        )
        self._layers = Layers(
            names=self._names,
            dims=dims,
            parameters=self._parameters,
            values=values,
            shared=shared_arrays(file),
        )
        self._relations = Relations(
            file=file,
            text=text,
            values=values,
            parameters=self._parameters,
            layers=self._layers,
            functions=self._functions,
            findings=self._findings,
        )
        self._relations.recognised = dict(recognise(file))
        self._relations.held = _held(file)
        self._signals = Signals(
            file=file,
            text=text,
            names=self._names,
            values=values,
            findings=self._findings,
            value_of=self._relations.of,
            known=known,
        )
        # each asks the other: signals for what is connected, relations for windows
        self._relations.signals = self._signals
        self._values = values

    def model(self) -> ImportedModel:
        """Converts outputs, then feedback, then losses, and assembles the spec. Raises SpecError
        for errors, OtherLoopError if a closed loop differs from what was assumed.
        """
        outputs = {
            old: self._whole(source, ("Outputs", old)) for old, source in self._file.Outputs.items()
        }
        followed = 0
        # what closes one loop may read another input that is closed: the list grows while it is
        # followed
        while followed < len(self._signals.loops):
            self._close(self._signals.loops[followed])
            followed += 1
        # losses compare with what was logged, also of an input that is fed back (R9)
        self._signals.scoring = True
        losses = dict(self._losses())
        for kind, section, olds in (
            ("input", "Inputs", self._file.Inputs),
            ("output", "Outputs", self._file.Outputs),
        ):
            for old in olds:
                new = self._names.of(kind, old)
                used = (
                    # an input that nothing reads is not in the spec, and its name of no interest
                    kind == "output" or old in self._signals.inputs or old in self._signals.targets
                )
                if new != old and used:
                    place = self._text.place(section, old)
                    self._findings.report(renamed(old, new, place))
        for array in self._layers.copied:
            section = "Parameters" if array in self._file.Parameters else "Constants"
            self._findings.report(copied(array, self._text.place(section, array)))
        hints = {
            id(term): old
            for old, value in self._relations.known.items()
            for term in value.pieces
            if len(value.pieces) == 1
        }
        sections = Sections(
            name=self._name,
            file=self._file,
            names=self._names,
            parameters=self._parameters,
            layers=self._layers,
            functions=self._functions,
            signals=self._signals,
            equations=Equations(names=self._names, hints=hints),
            outputs=outputs,
            held={
                self._relations.values_name(old): term
                for old, term in self._relations.held.items()
                if term is not None
            },
            losses=losses,
        )
        spec = spec_values(sections)
        names = {
            kind: {old: self._names.of(kind, old) for old in olds}
            for kind, olds in (("input", self._file.Inputs), ("output", self._file.Outputs))
        }
        return ImportedModel(
            spec=spec,
            weights=self._parameters.weights,
            names=names,
            warnings=self._findings.in_order,
            text=self._text,
        )

    def _whole(self, source: str, path: tuple[str, ...]) -> Term:
        if source not in self._file.Relations:
            place = self._text.place(*path)
            wanted = unknown_name(".".join(path), source, "relation", place)
            raise self._relations.refused(wanted)
        return self._values.whole(self._relations.of(source))

    def _close(self, name: str) -> None:
        source = self._file.Inputs[name].closed_loop
        assert source is not None
        path = ("Inputs", name, "closedLoop")
        if source not in self._file.Relations:
            place = self._text.place(*path)
            raise self._relations.refused(unknown_name(".".join(path), source, "relation", place))
        try:
            self._signals.close(name, self._relations.of(source))
        except ShapeError as fault:
            place = self._text.place(*path)
            raise self._relations.refused(unfit_shapes(".".join(path), str(fault), place)) from None

    def _losses(self) -> Iterator[tuple[str, tuple[str, Term, Term]]]:
        for old, given in self._file.Minimizers.items():
            sides: list[Term] = []
            for side, source in (("A", given.A), ("B", given.B)):
                sides.append(
                    self._whole(self._file.Outputs.get(source, source), ("Minimizers", old, side))
                )
            if given.loss not in {"mse", "rmse", "mae", "cross_entropy"}:
                place = self._text.place("Minimizers", old, "loss")
                path = f"Minimizers.{old}.loss"
                what = f"a loss `{given.loss}` is not known"
                repair = "train for `mse`, `rmse`, `mae` or `cross_entropy`"
                raise self._relations.refused(unknown_relation(path, what, repair, place))
            yield old, (given.loss, sides[0], sides[1])


def _held(file: File) -> dict[str, Term | None]:
    # `grad` of the language is by an entry: what it is taken by becomes an equation of its own
    operands = [names_in(one[1]) for one in file.Relations.values() if one[0] == "Differentiate"]
    return {names[1]: None for names in operands if len(names) == 2}


_HEAD = """\
# {name}: a model of nnodely 1.x, read from {file}.
# Its weights are in {weights}; the initial values here are those too, where they are few.
# nnodely knows no units: `unit:` of inputs and parameters lets msnn check them.

"""


@dataclass(frozen=True, slots=True)
class WrittenImport:
    """The paths of the files of an import, the converted model, and notes for the user."""

    spec: Path
    weights: Path
    warnings: tuple[Diagnostic, ...]
    model: ImportedModel


def write_import(file: Path, out: Path | None) -> WrittenImport:
    """Converts a saved model, and writes its spec to `out` (default: beside `file`) and its weights
    beside that. Raises SpecError for errors, and if one of the files exists; OSError if a file
    cannot be written.
    """
    read = read_text(file)
    # a folder exists; the file of that name in it is not what was said
    if out is not None and out.is_dir():
        raise SpecError([file_exists(str(out))])
    spec_file = file.with_name(f"{_stem(file)}.msnn.yaml") if out is None else out
    weights_file = spec_file.with_name(f"{_stem(spec_file)}.safetensors")
    for written in (spec_file, weights_file):
        if written.exists():
            raise SpecError([file_exists(str(written))])
    # the name of the spec becomes names of C and folders
    name = legal_name(_stem(spec_file))
    model = import_text(read, str(file), name)
    text, program = compiled(model, file.name, spec_file, weights_file.name)
    weights = {
        name: np.asarray(model.weights.get(name, value), np.float64).reshape(value.shape)
        for name, value in initial_weights(program).items()
    }
    # weights first: a spec that is there is complete
    write_weights(weights_file, weights, program)
    try:
        write_text(spec_file, text)
    except OSError:
        # weights without their spec are of no use
        weights_file.unlink(missing_ok=True)
        raise
    return WrittenImport(spec_file, weights_file, model.warnings, model)


def compiled(model: ImportedModel, file: str, path: Path, weights: str) -> tuple[str, Program]:
    """The text of the converted spec and its program. `file` and `weights` are names for its
    comment, `path` is where it will be written. Raises SpecError if it does not compile.
    """
    try:
        # compiled as it will be read, from its text
        text = spec_text(model, file, weights)
        read = read_spec(path, text)
        return text, compile_spec(read.spec, used=read.used).program
    except SpecError as fault:
        reasons = [describe(one) for one in fault.diagnostics if one.severity == "error"]
        raise SpecError([does_not_compile("; ".join(reasons[:3]))]) from None


def spec_text(model: ImportedModel, file: str, weights: str) -> str:
    """The text of the converted spec, with a comment that names the original file and that of the
    weights.
    """
    sections = [yaml_text({key: value}) for key, value in model.spec.items()]
    head, rest = "".join(sections[:3]), "\n".join(sections[3:])
    # a line break in the name of a file would end the comment
    shown = "".join(c if c.isprintable() else " " for c in file)
    remark = _HEAD.format(name=model.spec["name"], file=shown, weights=weights)
    return format_spec("imported.msnn.yaml", f"{remark}{head}\n{rest}")


def _stem(path: Path) -> str:
    name = path.name
    for ending in (".json", ".yaml", ".yml", ".msnn"):
        name = name.removesuffix(ending)
    return name

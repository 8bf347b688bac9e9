"""Checks a spec like `msnn check`, and collects names, types, units, samples and places."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from compiler.ir.nodes import extents
from compiler.ir.types import Axis, Type, describe_axes
from compiler.lowering.context import Declaration, Kind, Scope
from msnn.model.model import Model
from msnn.project.workflow_checks import checked_model
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings, SpecError
from spec_schema.diagnostics.source import SourceText, Span
from spec_schema.fields.leaf import Located
from spec_schema.sections.layers import Layer
from spec_schema.sections.signals import Equation, Output, Signal, State
from spec_schema.sections.spec import Spec
from spec_schema.sections.submodels import Use
from spec_schema.sections.values import Constant, Dimension, Function, Parameter
from spec_schema.units.unit import Unit


@dataclass(frozen=True, slots=True, kw_only=True)
class Known:
    """A name of the model: its kind, place, and the facts that the compiler knows about it."""

    name: str
    kind: Kind
    place: Span
    """Place of its key, in its own file."""
    shape: str | None = None
    """Axes as in messages; None if it is not a value or is unknown."""
    unit: str | None = None
    reads: str | None = None
    """The samples that the step, losses or start read."""
    doc: str = ""
    arguments: tuple[str, ...] = ()
    """Arguments of a function."""
    is_new: bool = False
    """True if no model with this name has compiled yet."""


@dataclass(frozen=True)
class Knowledge:
    """The names of a model by name, those of sub-models with dots, and the texts of its files."""

    names: Mapping[str, Known] = field(default_factory=dict[str, Known])
    sources: Mapping[str, SourceText] = field(default_factory=dict[str, SourceText])
    """The texts of these files, by path."""


def knowledge_of(model: Model) -> Knowledge:
    """The names of a compiled model with their facts, and the texts of its files."""
    reads = _samples_read(model)
    # findings are thrown away: the model has compiled, and its check has told them
    scope = Scope(model.spec, Findings())
    names = {
        name: _known(declaration, model, reads.get(name)) for name, declaration in scope.items()
    }
    return Knowledge(names, {source.path: source for source in model.sources})


def _known(declaration: Declaration, model: Model, reads: str | None) -> Known:
    entry = declaration.entry
    type = _type(declaration, model)
    doc: str | None = None
    arguments: tuple[str, ...] = ()
    match entry:
        case Dimension(labels=labels):
            doc = ", ".join(labels)
        case Function(doc=doc, args=args):
            arguments = tuple(argument.value for argument in args)
        case Layer():
            doc = f"a {_chosen(entry)} layer"
        case Use():
            pass
        case Signal() | Constant() | Parameter() | State() | Equation() | Output():
            doc = entry.doc
    return Known(
        name=declaration.name,
        kind=declaration.kind,
        place=entry.place.key,
        shape=None if type is None else describe_axes(type.axes),
        unit=None if type is None or type.unit is None else type.unit.text,
        reads=reads,
        doc=doc or "",
        arguments=arguments,
    )


def _chosen(layer: Layer) -> str:
    return next(name for name in layer.known_keys() if getattr(layer, name) is not None)


def _type(declaration: Declaration, model: Model) -> Type | None:
    match declaration.entry:
        case Dimension(size=size):
            return Type((Axis(declaration.name, size),))
        case Equation() | Output():
            return model.types.get(declaration.name)
        case Signal() | State() | Parameter() | Constant() as entry:
            return Type(_axes(entry.dims, model.spec), _unit(entry.unit))
        case Layer() | Function() | Use():
            return None


def _axes(dims: Sequence[Located[str]], spec: Spec) -> tuple[Axis, ...]:
    known = (dim.value for dim in dims if dim.value in spec.dims)
    return tuple(Axis(name, spec.dims[name].size) for name in known)


def _unit(unit: Located[Unit] | None) -> Unit | None:
    return None if unit is None else unit.value


def _samples_read(model: Model) -> dict[str, str]:
    """The samples of each signal that the step, losses and start read, as text: `t-4 … t in the
    step, t+1 in losses`.
    """
    program = model.program
    parts = (
        ("the step", extents(program.step, log=False), "t"),
        # the log is read in the step by losses and `predicts` alone
        ("losses", extents(program.step, log=True), "t"),
        ("the start", extents(program.start, log=True), "t0"),
    )
    said: dict[str, list[str]] = {}
    for where, found, now in parts:
        for name, extent in found.items():
            said.setdefault(name, []).append(f"{extent.text(now)} in {where}")
    return {name: ", ".join(reads) for name, reads in said.items()}


def members(names: Mapping[str, Known], base: str) -> Iterator[Known]:
    """The names directly below the sub-model `base`, such as `plant.k` for `plant`, but not
    `plant.a.k`.
    """
    start = f"{base}."
    for name, known in names.items():
        if name.startswith(start) and "." not in name[len(start) :]:
            yield known


@dataclass(frozen=True)
class Examined:
    """The result of a check: errors or warnings of a text, and its names; `knowledge` is None if
    the model does not compile.
    """

    diagnostics: tuple[Diagnostic, ...]
    sources: Mapping[str, SourceText] = field(default_factory=dict[str, SourceText])
    """The texts that diagnostics point into, by path."""
    knowledge: Knowledge | None = None


def examine(path: str, text: str, unsaved: Mapping[str, str]) -> Examined:
    """Runs `msnn check` on `text` as the contents of the file `path`. Errors of the spec are in the
    result.

    `unsaved` maps real paths of other files to texts that are used instead of the saved ones.
    """
    try:
        model = checked_model(Path(path), text=text, unsaved=unsaved)
    except SpecError as error:
        # without knowledge: that of the last text that compiled stays in use
        return Examined(error.diagnostics, {source.path: source for source in error.sources})
    sources = {source.path: source for source in model.sources}
    return Examined(model.warnings, sources, knowledge_of(model))

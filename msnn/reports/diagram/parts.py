"""Lists the parts of a spec, and their dependencies."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

from spec_schema.fields.entry import Entry
from spec_schema.sections.references import names_in
from spec_schema.sections.spec import Spec

Kind = Literal[
    "inputs", "targets", "parameters", "layers", "states", "equations", "outputs", "losses"
]
KINDS: tuple[Kind, ...] = (
    "inputs",
    "targets",
    "parameters",
    "layers",
    "states",
    "equations",
    "outputs",
    "losses",
)


@dataclass(frozen=True, slots=True)
class Part:
    """An entry of the spec."""

    name: str
    kind: Kind
    about: str
    """Its unit, or the kind of layer; may be empty."""


@dataclass(frozen=True, slots=True)
class Arrow:
    """A dependency: the formula of `target` uses `source`, or `source` predicts `target`."""

    source: str
    target: str
    predicts: bool = False


@dataclass(frozen=True, slots=True)
class Parts:
    """All parts, in the order of the spec."""

    parts: tuple[Part, ...]
    arrows: tuple[Arrow, ...]


def parts_of(spec: Spec) -> Parts:
    """An arrow from every name in a formula to the item that it defines.

    An output also has an arrow to the signal that it predicts. A state that uses itself has no
    arrow.
    """
    kinds: dict[str, Kind] = {name: kind for kind in KINDS for name in getattr(spec, kind)}
    arrows: list[Arrow] = []
    for name, kind in kinds.items():
        for used in dict.fromkeys(_used_by(spec, kind, name)):
            if used in kinds and (used, kind) != (name, "states"):
                arrows.append(Arrow(used, name))
        if kind == "outputs" and (prediction := spec.outputs[name].predicts) is not None:
            signal = prediction.signal.value
            if signal in kinds:
                arrows.append(Arrow(name, signal, predicts=True))
    parts = tuple(Part(name, kind, _about(spec, kind, name)) for name, kind in kinds.items())
    return Parts(parts, tuple(arrows))


def _about(spec: Spec, kind: Kind, name: str) -> str:
    if kind == "layers":
        layer = spec.layers[name]
        # a layer is a record of options of which exactly one kind is set
        set_fields = (key for key in type(layer).model_fields if key != "place")
        return next(key for key in set_fields if getattr(layer, key) is not None)
    entry: Any = getattr(spec, kind)[name]
    unit = getattr(entry, "unit", None)
    return f"[{unit.value.text}]" if unit is not None else ""


def formulas_of(spec: Spec, kind: Kind, name: str) -> Any:
    """The expressions of an entry; none for a signal."""
    entry: Entry = getattr(spec, kind)[name]
    if kind in ("inputs", "targets"):
        return ()
    # `predicts` is no formula: its signal is an arrow of its own kind, the other way
    return tuple(getattr(entry, field) for field in type(entry).model_fields if field != "predicts")


def _used_by(spec: Spec, kind: Kind, name: str) -> Iterator[str]:
    """Every name in the formulas of an entry; functions are replaced by the names they use."""
    # a stack, reversed: names come out as the formula has them, those of a function in its place
    waiting = list(names_in(formulas_of(spec, kind, name)))[::-1]
    while waiting:
        used = waiting.pop()
        yield used
        if used in spec.functions:
            called = spec.functions[used]
            # arguments shadow entries of the spec
            own = {argument.value for argument in called.args}
            waiting += [n for n in names_in(called.expr) if n not in own][::-1]

"""Selects the contents of an architecture diagram: boxes, wires, feedback."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from spec_schema.expressions.tree import Call, Name
from spec_schema.fields.entry import Entry
from spec_schema.sections.references import calls_in, names_in
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
    """A box of a diagram before layout: an entry of the spec, such as a signal or a layer."""

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
    """The entries of a spec in its order, and the dependencies between them."""

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


SHOWN: tuple[Kind, ...] = ("inputs", "states", "layers", "equations", "outputs")


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    """A part of the diagram, with the parameters it uses."""

    name: str
    kind: Kind
    about: str
    uses: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Wire:
    """A line of the diagram from one box to another."""

    source: str
    target: str


@dataclass(frozen=True, slots=True)
class Flow:
    """Boxes in the order of the spec; acyclic forward wires, and feedback wires."""

    boxes: tuple[Box, ...]
    forward: tuple[Wire, ...]
    back: tuple[Wire, ...]
    """Wires into states, which define their next value, and into predicted inputs."""


def flow_of(spec: Spec) -> Flow:
    """The boxes and wires of a spec, without losses and targets.

    Arguments of a layer are wired to the layer, and the layer to its caller. A wire into a state is
    feedback unless it comes from an input. Remaining cycles, e.g. of a layer with two calls, are
    broken by a feedback wire.
    """
    found = parts_of(spec)
    kinds: dict[str, Kind] = {part.name: part.kind for part in found.parts}
    wires: dict[Wire, None] = {}
    uses: dict[str, list[str]] = {}
    for part in found.parts:
        if part.kind not in SHOWN:
            continue
        for wire in _wires(spec, formulas_of(spec, part.kind, part.name), part.name):
            kind = kinds.get(wire.source)
            if kind == "parameters" and wire.source not in uses.setdefault(wire.target, []):
                uses[wire.target].append(wire.source)
            # a layer that names itself is its own array (`h.weight`); a state that does is a loop
            elif kind in SHOWN and (wire.source != wire.target or kind == "states"):
                wires[wire] = None
        if part.kind == "layers" and (sets := spec.layers[part.name].fuzzify) is not None:
            wires |= {Wire(each.value, part.name): None for each in sets.over}
    wires |= {Wire(a.source, a.target): None for a in found.arrows if a.predicts}
    # a prediction of a target leads out of the picture
    wires = {wire: None for wire in wires if kinds.get(wire.target) in SHOWN}
    boxes = tuple(
        Box(name=p.name, kind=p.kind, about=p.about, uses=tuple(uses.get(p.name, ())))
        for p in found.parts
        if p.kind in SHOWN
    )
    back = [wire for wire in wires if _feeds_back(wire, kinds)]
    forward, circular = _without_circles(boxes, [wire for wire in wires if wire not in back])
    return Flow(boxes, tuple(forward), (*back, *circular))


def _wires(spec: Spec, value: Any, target: str) -> Iterator[Wire]:
    """Wires from the names in formulas, via the layers they call, to the defined item."""
    # counted: a name inside a call may stand outside of it once more, and is a wire of its own then
    outside = Counter(names_in(value))
    for call in _layer_calls(spec, value):
        # as `_layer_calls` has them
        assert isinstance(call.function, Name)
        layer, inside = call.function.name, (call.arguments, call.keywords)
        outside -= Counter([layer, *names_in(inside)])
        yield from _wires(spec, inside, layer)
        yield Wire(layer, target)
    for name in outside:
        if name in spec.functions:
            called = spec.functions[name]
            # arguments shadow entries of the spec, and what the call gives them is named at the
            # call
            own = {argument.value for argument in called.args}
            for wire in _wires(spec, called.expr, target):
                if wire.source not in own:
                    yield wire
        else:
            yield Wire(name, target)


def _layer_calls(spec: Spec, value: Any) -> list[Call]:
    """The outermost calls of layers."""
    found: list[Call] = []
    inner: set[int] = set()
    for call in calls_in(value):
        # by identity: two calls that are written alike are equal trees, and both are calls
        if id(call) in inner or not isinstance(call.function, Name):
            continue
        if call.function.name in spec.layers:
            found.append(call)
            inner |= {id(each) for each in calls_in((call.arguments, call.keywords))}
    return found


def _feeds_back(wire: Wire, kinds: Mapping[str, Kind]) -> bool:
    target = kinds[wire.target]
    # what an input does to a state is seen from left to right; only the model's own answer goes
    # back
    return target == "inputs" or (target == "states" and kinds[wire.source] != "inputs")


def _without_circles(boxes: Iterable[Box], wires: Iterable[Wire]) -> tuple[list[Wire], list[Wire]]:
    """An acyclic set of wires, and the wires that would close a cycle."""
    following: dict[str, list[str]] = {}
    forward: list[Wire] = []
    circular: list[Wire] = []
    for wire in wires:
        # in the order of the spec, so that the same wire is turned round whenever it is drawn
        if _reaches(following, wire.target, wire.source):
            circular.append(wire)
        else:
            following.setdefault(wire.source, []).append(wire.target)
            forward.append(wire)
    return forward, circular


def _reaches(following: Mapping[str, list[str]], begin: str, end: str) -> bool:
    waiting, seen = [begin], {begin}
    while waiting:
        name = waiting.pop()
        if name == end:
            return True
        for after in following.get(name, ()):
            if after not in seen:
                seen.add(after)
                waiting.append(after)
    return False

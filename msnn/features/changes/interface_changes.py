"""Compares the interfaces of two models, and finds changes that break their users."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal, cast

from compiler.ir.program import Program
from msnn.exports.export import target_named
from msnn.exports.table import every_target
from msnn.model.model import Model
from msnn.reports.show import interface_record
from spec_schema.diagnostics.source import Span
from spec_schema.fields.leaf import Located
from spec_schema.sections.exports import TargetEntry

Part = Literal["input", "output", "parameter", "state", "start from"]
NAME_IN_EXPORTS = "name in exports"
_Bounds = list[float | None] | None


@dataclass(frozen=True, slots=True)
class Property:
    """A property of an input, output, parameter or state as text, such as its unit, and the effect
    on users if it changes.
    """

    name: str
    text: str
    breaks: str = ""
    allowed: tuple[float, float] | None = None
    """A range that users must respect: only a narrower one breaks them."""
    promised: tuple[float, float] | None = None
    """A range that users rely on: only a wider one breaks them."""

    def broken_by(self, new: Property) -> str:
        """The effect on users of the model if this property changes to `new`. Empty if the change
        is compatible: an allowed range that covers the old one, a promised range within the old
        one.
        """
        if self.allowed is not None and new.allowed is not None:
            return "" if _covers(new.allowed, self.allowed) else self.breaks
        if self.promised is not None and new.promised is not None:
            return "" if _covers(self.promised, new.promised) else self.breaks
        return self.breaks


def properties(part: Part, item: Mapping[str, Any]) -> tuple[Property, ...]:
    """The properties of one item of `interface_record`: unit, shape, name in exports, range, and by
    kind also the samples that are read or the predicted signal.

    `part` is the kind of the item. Items of one kind have the same properties in the same order.
    """
    common = (
        Property("unit", item["unit"] or "", "numbers mean something else"),
        Property("shape", _shape(item["axes"]), "arrays have another size"),
        Property(NAME_IN_EXPORTS, item["port"], "it is called by another name"),
    )
    match part:
        case "start from":  # the rest is said of the input or state
            return (_window(item),)
        case "input":
            accepted = "values that were allowed are flagged"
            return (*common, _window(item), _range(item["range"], accepted, is_promise=False))
        case "output":
            predicts = Property("predicts", _predicted(item["predicts"]), "it is another quantity")
            promise = "values may lie where none was"
            return (*common, predicts, _range(item["range"], promise, is_promise=True))
        case "parameter":
            accepted = "values that were allowed are not"
            return (*common, _range(item["range"], accepted, is_promise=False))
        case "state":
            return common


def _range(bounds: _Bounds, breaks: str, *, is_promise: bool) -> Property:
    low, high = bounds or (None, None)
    # an open side covers everything, so that no case of its own is needed
    ends = (-math.inf if low is None else low, math.inf if high is None else high)
    text = "" if ends == (-math.inf, math.inf) else f"{ends[0]:g} … {ends[1]:g}"
    if is_promise:
        return Property("range", text, breaks, promised=ends)
    return Property("range", text, breaks, allowed=ends)


def _covers(wide: tuple[float, float], narrow: tuple[float, float]) -> bool:
    return wide[0] <= narrow[0] and narrow[1] <= wide[1]


def _shape(axes: list[dict[str, Any]]) -> str:
    return " × ".join(f"{axis['name']} {axis['size']}" for axis in axes)


def _window(item: Mapping[str, Any]) -> Property:
    first, last = (_sample(item[end]) for end in ("first_sample", "last_sample"))
    text = first if first == last else f"{first} … {last}"
    return Property("samples", text, "other samples must be given")


def _sample(at: int) -> str:
    return f"t{at:+d}" if at else "t"


def _predicted(predicts: Mapping[str, Any] | None) -> str:
    return "" if predicts is None else f"{predicts['signal']}[{_sample(predicts['ahead'])}]"


@dataclass(frozen=True, slots=True, kw_only=True)
class InterfaceChange:
    """A changed property of a part of the interface. `old` and `new` are its texts; None if the
    part does not exist in that model.
    """

    part: str
    """`input F`, or `sample time`."""
    what: str
    """`unit`, or empty for the complete part."""
    old: str | None
    new: str | None
    breaks: str
    """The effect on users of the model; empty if the change is compatible."""
    span: Span | None
    """Place in the new spec."""


@dataclass(frozen=True, slots=True)
class _Kind:
    """A kind of interface item: its section in `interface_record`, its name in messages, and the
    effects on users if an item appears or goes. An empty effect breaks nobody.
    """

    section: str
    part: Part
    appears: str
    goes: str


_KINDS = (
    _Kind("inputs", "input", "who calls the step must give it", "who calls the step gives it"),
    _Kind("outputs", "output", "", "who reads it finds nothing"),
    _Kind("parameters", "parameter", "", "who sets it finds nothing"),
    _Kind("states", "state", "", "who reads or sets it finds nothing"),
    _Kind(
        "start_windows",
        "start from",
        "who starts the model must give it",
        "who starts the model gives it",
    ),
)


def interface_changes(old: Program, new: Program) -> tuple[InterfaceChange, ...]:
    """The differences of the exported interfaces of two models: name, sample time and lateness
    first, then inputs, outputs, parameters, states, start samples and dimensions.

    Buffers are internal, except for the samples that a start needs. Docs and initial guesses are
    ignored.
    """
    before, after = interface_record(old), interface_record(new)
    spans = _spans(new)
    found = [
        *_of_model(before, after),
        *(change for kind in _KINDS for change in _of_kind(kind, before, after, spans)),
        *_of_dimensions(before, after),
    ]
    return tuple(found)


def _of_model(old: Mapping[str, Any], new: Mapping[str, Any]) -> Iterator[InterfaceChange]:
    facts = (
        ("model", str(old["model"]), str(new["model"]), "functions and types have its name"),
        (
            "sample time",
            _seconds(old["sample_time"]),
            _seconds(new["sample_time"]),
            "the step is called at another rate",
        ),
        (
            "outputs are late by",
            f"{old.get('late', 0)} samples",
            f"{new.get('late', 0)} samples",
            "outputs belong to another sample",
        ),
    )
    for part, before, after, breaks in facts:
        if before != after:
            yield InterfaceChange(
                part=part, what="", old=before, new=after, breaks=breaks, span=None
            )


def _of_kind(
    kind: _Kind,
    old: Mapping[str, Any],
    new: Mapping[str, Any],
    spans: Mapping[str, Span | None],
) -> Iterator[InterfaceChange]:
    before, after = _by_name(old[kind.section]), _by_name(new[kind.section])
    # both, without doubles: what went stands where it was
    for name in dict.fromkeys((*before, *after)):
        part, span = f"{kind.part} {name}", spans.get(name)
        left, right = before.get(name), after.get(name)
        if left is not None and right is not None:
            # of one kind the same properties in the same order
            pairs = zip(properties(kind.part, left), properties(kind.part, right), strict=True)
            for one, other in pairs:
                if one.text != other.text:
                    yield InterfaceChange(
                        part=part,
                        what=one.name,
                        old=one.text,
                        new=other.text,
                        breaks=one.broken_by(other),
                        span=span,
                    )
        elif right is not None:
            yield InterfaceChange(
                part=part,
                what="",
                old=None,
                new=_described(kind.part, right),
                breaks=kind.appears,
                span=span,
            )
        elif left is not None:
            yield InterfaceChange(
                part=part,
                what="",
                old=_described(kind.part, left),
                new=None,
                breaks=kind.goes,
                span=None,
            )


def _of_dimensions(old: Mapping[str, Any], new: Mapping[str, Any]) -> Iterator[InterfaceChange]:
    """Changes of the labels of dimensions that both models have, in number equal; labels give the
    order of elements. Another number of labels changes shapes, which `properties` compares.
    """
    before, after = _by_name(old["dimensions"]), _by_name(new["dimensions"])
    # in the order of the spec: a set of names has another one in each process
    for name in (name for name in before if name in after):
        left, right = before[name]["labels"], after[name]["labels"]
        # another length is told of every array that has the dimension
        if left != right and len(left) == len(right):
            yield InterfaceChange(
                part=f"dimension {name}",
                what="labels",
                old=", ".join(left),
                new=", ".join(right),
                breaks="elements stand in another order or have other names",
                span=None,
            )


def _by_name(items: list[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    return {item["name"]: item for item in items if _is_shown(item)}


def _is_shown(item: Mapping[str, Any]) -> bool:
    return item.get("origin", {}).get("kind", "declared") == "declared"


def _described(part: Part, item: Mapping[str, Any]) -> str:
    # it follows from the name, which stands beside
    facts = (each for each in properties(part, item) if each.name != NAME_IN_EXPORTS)
    return ", ".join(each.text for each in facts if each.text) or "there"


def _seconds(sample_time: float | None) -> str:
    return "" if sample_time is None else f"{sample_time:g} s"


def _spans(program: Program) -> dict[str, Span | None]:
    parts = (*program.states, *program.parameters, *program.signals, *program.outputs)
    return {part.name: part.span for part in parts}


_BREAKS = {
    "dtype": "numbers have another type",
    "prefix": "functions, types and files have other names",
    "params": "parameters are given in another way",
    "delay": "outputs belong to another sample",
    "close": "other inputs are to be given",
}
"""Keys of targets whose changes affect callers, with the reason."""


def export_changes(old: Model, new: Model) -> tuple[InterfaceChange, ...]:
    """The differences of the keys in `_BREAKS`, for each target that the `export` sections of both
    specs have. Targets in one spec only are ignored.
    """
    return tuple(_changes(old, new))


def _changes(old: Model, new: Model) -> Iterator[InterfaceChange]:
    for target in (each.name for each in every_target()):
        before, after = _entry(old, target), _entry(new, target)
        if before is None or after is None:
            continue
        for key, breaks in _BREAKS.items():
            one, other = getattr(before, key, None), getattr(after, key, None)
            if one == other:  # no target has to be loaded for its default
                continue
            left, right = _text(one, target, key), _text(other, target, key)
            if left != right:
                yield InterfaceChange(
                    part=f"export {target}",
                    what=key,
                    old=left,
                    new=right,
                    breaks=breaks,
                    span=after.place.key,
                )


def _entry(model: Model, target: str) -> TargetEntry | None:
    section = model.spec.export
    return None if section is None else getattr(section, target)


def _text(value: object, target: str, key: str) -> str:
    """The value of a key of a target as text. Names are sorted, as their order does not matter.
    None is the target's default `dtype`, and empty for other keys.
    """
    match value:
        case None if key == "dtype":
            return target_named(target).dtype
        case None:
            return ""  # a prefix: the name of the model, which is compared by itself
        case tuple():
            names = cast("tuple[Located[str], ...]", value)
            return ", ".join(sorted(each.value for each in names))
        case Located():
            return str(cast("Located[object]", value).value)
        case _:
            return str(value)

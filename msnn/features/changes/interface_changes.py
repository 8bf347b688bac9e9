"""Compares the interfaces of two models, and finds changes that break their users."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from compiler.ir.program import Program
from msnn.features.changes.part_properties import NAME_IN_EXPORTS, Part, properties
from msnn.reports.show import interface_record
from spec_schema.diagnostics.source import Span


@dataclass(frozen=True, slots=True, kw_only=True)
class InterfaceChange:
    """A changed property of a part of the interface; None if the part does not exist."""

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
    """A kind of part, and the effects of adding or removing one."""

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
    """The differences of the exported interfaces of two models, in the order of `show`.

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
    """Changes of label order, which is the order of elements; sizes are reported with signals."""
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

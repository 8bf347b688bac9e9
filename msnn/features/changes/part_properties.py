"""Lists the properties of an input, output, parameter or state that users rely on."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

Part = Literal["input", "output", "parameter", "state", "start from"]
NAME_IN_EXPORTS = "name in exports"
_Bounds = list[float | None] | None


@dataclass(frozen=True, slots=True)
class Property:
    """A property as text, and the effect of a change."""

    name: str
    text: str
    breaks: str = ""
    allowed: tuple[float, float] | None = None
    """A range that users must respect: only a narrower one breaks them."""
    promised: tuple[float, float] | None = None
    """A range that users rely on: only a wider one breaks them."""

    def broken_by(self, new: Property) -> str:
        """The effect of replacing this property by the new one; empty if compatible."""
        if self.allowed is not None and new.allowed is not None:
            return "" if _covers(new.allowed, self.allowed) else self.breaks
        if self.promised is not None and new.promised is not None:
            return "" if _covers(self.promised, new.promised) else self.breaks
        return self.breaks


def properties(part: Part, item: Mapping[str, Any]) -> tuple[Property, ...]:
    """The properties of one part, always in the same order."""
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

"""What an expression may read at its place, and the entries that it brings into the spec."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

from tests.random_specs.terms import SCALAR, Shape, Term, leaf

DIMS = {"a": 2, "b": 3, "d": 2, "c": ["left", "mid", "right", "far"]}
SIZES = {"a": 2, "b": 3, "d": 2, "c": 4}
WINDOWS = (5, 6)
"""Lengths that no dim has: a dim as long as a window runs along it (R3)."""
LISTS = (2, 3)

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Value:
    """A name with a value of one sample."""

    name: str
    shape: Shape
    from_inputs: bool
    """Whether its past is known from the log: it depends on inputs, parameters and time alone."""
    has_past: bool
    """Whether earlier samples of it may be read."""
    logged: bool = False
    """Whether later samples of it may be read."""
    varies: bool = True
    """Whether a gradient with respect to it can be asked for."""


@dataclass(slots=True)
class Scope:
    """Chance, the values that there are, and the sections that are being written."""

    chance: random.Random
    sections: dict[str, dict[str, Any]]
    values: list[Value] = field(default_factory=list)
    pure: bool = False
    """Only what depends on inputs alone may be read."""
    previews: bool = True
    """Whether later samples of inputs may be read."""
    memory: bool = True
    """Whether integrals, filters and other calls that keep something may stand here."""
    counter: list[int] = field(default_factory=lambda: [0])

    def restricted(self, **changes: Any) -> Scope:
        """The same with other permissions."""
        return replace(self, **changes)

    def one_of(self, choices: Sequence[T]) -> T:
        """One of them."""
        return self.chance.choice(choices)

    def often(self, share: float) -> bool:
        """True in this share of cases."""
        return self.chance.random() < share

    def number(self, low: float = -1.0, high: float = 1.0) -> str:
        """A number with few digits, never 0."""
        return f"{round(self.chance.uniform(low, high), 2) or 0.37:g}"

    def new_name(self, prefix: str) -> str:
        """A name that nothing else has."""
        self.counter[0] += 1
        return f"{prefix}{self.counter[0]}"

    def declare(self, section: str, prefix: str, entry: Any) -> str:
        """Writes an entry under a new name, which is returned."""
        name = self.new_name(prefix)
        self.sections.setdefault(section, {})[name] = entry
        return name

    def parameter(self, shape: Shape) -> Term:
        """A parameter of this shape, new or old; of dims alone."""
        dims = sorted(shape.dims)
        known = [
            name
            for name, entry in self.sections.get("parameters", {}).items()
            if sorted(entry.get("dims", [])) == dims
        ]
        if known and self.often(0.5):
            return leaf(self.one_of(known))
        entry: dict[str, Any] = {"init": float(self.number(0.1, 0.9))}
        if dims:
            entry["dims"] = dims
            entry["init"] = self.one_of(
                [
                    entry["init"],
                    {"normal": {"mean": 0, "std": 0.4}},
                    {"uniform": {"min": 0.1, "max": 0.8}},
                    {"lin": {"first": 0.2, "last": 0.7}},
                    {"exp": {"first": 0.8, "rate": 2}},
                    {"negexp": {"last": 0.8, "rate": 2}},
                    Term("0.1 + 0.2 * i / n"),
                ]
            )
        bounded = not isinstance(entry["init"], dict) or "normal" not in entry["init"]
        if bounded and self.often(0.3):
            entry["min"] = -0.05
        if bounded and self.often(0.3):
            entry["max"] = 3
        if self.often(0.2):
            entry["scale"] = 2
        if self.often(0.15):
            entry["learn"] = False
        return leaf(self.declare("parameters", "p", entry))

    def _constant(self, shape: Shape) -> Term:
        """A new constant of dims alone."""
        dims = sorted(shape.dims)
        if not dims:
            return leaf(self.declare("constants", "k", self.one_of((0.31, "sqrt(0.2)", "-pi / 7"))))
        entry: dict[str, Any] = {"dims": dims, "value": float(self.number())}
        if len(dims) == 1:
            entry["value"] = [float(self.number()) for _ in range(SIZES[dims[0]])]
        return leaf(self.declare("constants", "k", entry))

    def readable(self, fits: Callable[[Value], bool]) -> list[Value]:
        """Values that may be read here and fit."""
        return [v for v in self.values if fits(v) and (v.from_inputs or not self.pure)]

    def name(self, shape: Shape) -> Term:
        """A leaf of the shape: a value, a window of one, a parameter, numbers."""
        if shape.window:
            return self._window(shape)
        if shape.listed:
            numbers = ", ".join(self.number() for _ in range(shape.listed))
            if shape.dims:
                return Term(f"{{0}} * [{numbers}]", (self.name(Shape(shape.dims)),))
            return leaf(f"[{numbers}]")
        found = self.readable(lambda value: value.shape.dims == shape.dims)
        if found and self.often(0.8):
            value = self.one_of(found)
            if value.has_past and self.often(0.25):
                return leaf(f"{value.name}[t-{self.one_of((1, 2, 3))}]")
            if value.logged and self.previews and self.often(0.1):
                return leaf(f"{value.name}[t+{self.one_of((1, 2))}]")
            return leaf(value.name)
        if shape == SCALAR and self.often(0.4):
            return leaf(self.number(0.1, 0.9))
        if self.often(0.1):
            return self._constant(shape)
        return self.parameter(shape)

    def _window(self, shape: Shape) -> Term:
        n, dims = shape.window, shape.dims
        found = self.readable(lambda value: value.shape.dims == dims and value.has_past)
        if not found:
            smaller = self.readable(lambda value: value.shape.dims < dims and value.has_past)
            base = self.one_of(smaller or [self.values[0]])
            missing = Shape(dims - base.shape.dims)
            window = self._past(base, n)
            return Term("{0} * {1}", (self.parameter(missing), window)) if missing.dims else window
        return self._past(self.one_of(found), n)

    def _past(self, value: Value, n: int) -> Term:
        if value.logged and self.previews and self.often(0.1):
            return leaf(f"{value.name}.future({n})")
        if self.often(0.2):
            return leaf(f"{value.name}[t-{n}:t-1]")
        if self.often(0.2):
            return leaf(f"{value.name}.past({100 * n} ms)")
        return leaf(f"{value.name}.past({n})")

"""Lists the members of the C struct that holds the state of a generated controller."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

Kind = Literal["real", "int32", "uint32", "uint8"]


@dataclass(frozen=True, slots=True)
class StructMember:
    """A scalar or an array of a C struct; `real` is the C floating-point type."""

    name: str
    kind: Kind
    shape: tuple[int, ...]
    real: str

    @property
    def c_type(self) -> str:
        """The C type of its elements."""
        return self.real if self.kind == "real" else f"{self.kind}_t"


@dataclass(frozen=True, slots=True, kw_only=True)
class Sizes:
    """The lengths of a solver's arrays."""

    horizon: int
    memory: int
    """Elements of x."""
    controls: int
    results: int
    """Result elements of a stage: next values, the cost, bounded values."""
    sides: int
    """Minima and maxima of all rows of a stage."""
    kept: int
    """Intermediate values of a stage that its values function saves for its derivatives."""
    kept_at_end: int
    """Intermediate values that the values function of the end of the horizon saves."""
    given: int
    """Disturbances and references of a stage."""
    limits_move: bool
    """True if limits depend on references."""
    has_hard: bool
    """True if a path limit is hard."""
    past_moves: bool
    """True if the struct needs a flag for steps that change past samples (condensed)."""


def members(sizes: Sizes, shapes: Mapping[str, tuple[int, ...]], real: str) -> list[StructMember]:
    """Lists the members in the order of the struct.

    `shapes` has the arrays that depend on the structure of the solver (`Form.shapes`).
    """
    stages = sizes.horizon + 1
    struct: list[StructMember] = []

    def add(kind: Kind, shape: tuple[int, ...], *names: str) -> None:
        struct.extend(StructMember(name, kind, shape, real) for name in names)

    add("uint32", (), "ready")
    add("int32", (), "has_plan", "is_shifted", "is_prepared", "is_pending")
    add("int32", (), "iterations", "short_steps", "simulations")
    if sizes.past_moves:
        add("int32", (), "past_moves")
    add("real", (), "mu", "slope", "gap", "product", "least_product", "residual")
    if sizes.has_hard:
        add("real", (), "hardness")
    add("real", (sizes.memory,), "measured")
    add("real", (sizes.controls,), "applied")
    for name, shape in shapes.items():
        add("real", shape, name)
    add("real", (stages, sizes.results), "results")
    add("real", (stages,), "cost")
    # C has no empty arrays
    add("real", (stages if sizes.kept_at_end else sizes.horizon, max(sizes.kept, 1)), "kept")
    if sizes.given:
        add("real", (stages, sizes.given), "given")
    sides = ["slack", "multiplier", "excess", "growth", "stiffness", "offset"]
    if sizes.limits_move:
        sides.append("limit")
    add("real", (stages, sizes.sides), *sides)
    add("uint8", (stages, sizes.sides), "live")
    add("uint8", (stages, sizes.controls), "room")
    add("uint8", (stages,), "is_new")
    return struct

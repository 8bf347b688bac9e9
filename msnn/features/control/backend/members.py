"""Lists the members of a controller's struct, for its header and for who reads it from outside."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

Kind = Literal["real", "int32", "uint32", "uint8"]


@dataclass(frozen=True, slots=True)
class StructMember:
    """A number or an array."""

    name: str
    kind: Kind
    shape: tuple[int, ...]
    real: str

    @property
    def c_type(self) -> str:
        """Its type in C."""
        return self.real if self.kind == "real" else f"{self.kind}_t"


@dataclass(frozen=True, slots=True, kw_only=True)
class Sizes:
    """The lengths of a solver's arrays."""

    horizon: int
    memory: int
    """Numbers of x."""
    controls: int
    results: int
    sides: int
    kept: int
    kept_at_end: int
    """Numbers that the values at the end of the horizon leave for its slopes."""
    given: int
    limits_move: bool
    has_hard: bool
    past_moves: bool
    """Whether steps tell samples of the past apart."""


def members(sizes: Sizes, shapes: Mapping[str, tuple[int, ...]], real: str) -> list[StructMember]:
    """In the order of the struct; `shapes` are those of the arrays that hang on the structure."""
    stages = sizes.horizon + 1
    found: list[StructMember] = []

    def add(kind: Kind, shape: tuple[int, ...], *names: str) -> None:
        found.extend(StructMember(name, kind, shape, real) for name in names)

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
    return found

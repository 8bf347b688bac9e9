"""Lists the members of a controller's struct, for its header and for who reads it from outside."""

from __future__ import annotations

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
    """What the arrays of a solver are as long as."""

    horizon: int
    states: int
    controls: int
    results: int
    sides: int
    kept: int
    given: int
    limits_move: bool
    has_hard: bool


def members(sizes: Sizes, real: str) -> list[StructMember]:
    """In the order of the struct."""
    stages, stage = sizes.horizon + 1, sizes.states + sizes.controls
    found: list[StructMember] = []

    def add(kind: Kind, shape: tuple[int, ...], *names: str) -> None:
        found.extend(StructMember(name, kind, shape, real) for name in names)

    add("uint32", (), "ready")
    add("int32", (), "has_plan", "is_shifted", "is_prepared", "is_pending")
    add("int32", (), "iterations", "short_steps", "simulations")
    add("real", (), "mu", "slope", "gap", "product", "residual")
    if sizes.has_hard:
        add("real", (), "hardness")
    add("real", (sizes.states,), "measured")
    add("real", (sizes.controls,), "applied")
    add("real", (stages, stage), "z", "dz", "gradient")
    add("real", (stages, sizes.states), "adjoint", "next_adjoint")
    add("real", (stages, sizes.results), "results")
    add("real", (stages,), "cost")
    add("real", (stages, max(sizes.kept, 1)), "kept")
    add("real", (stages, max(sizes.given, 1)), "given")
    add("real", (stages, sizes.results, stage), "slopes")
    add("real", (stages, stage, stage), "curvature")
    add("real", (sizes.horizon, sizes.controls, sizes.states), "gain")
    add("real", (sizes.horizon, sizes.controls), "advance")
    sides = ["slack", "multiplier", "excess", "growth", "stiffness", "offset"]
    if sizes.limits_move:
        sides.append("limit")
    add("real", (stages, sizes.sides), *sides)
    add("uint8", (stages, sizes.sides), "live")
    add("uint8", (stages, sizes.controls), "room")
    add("uint8", (stages,), "is_new")
    return found

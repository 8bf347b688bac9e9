"""Describes a generated controller: the members of its state struct, and its JSON description."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from backends.c_language.literals import Dtype
from backends.files.export_identity import OPEN
from backends.ports.metadata import metadata_text
from compiler.jacobian.matrices import Vector
from msnn.features.control.backend.inputs import SeriesField
from msnn.features.control.backend.structure.form import PlanLayout
from msnn.features.control.backend.structure.rows import Rows
from msnn.features.control.problem.optimal_control import ControlProblem


def about_text(
    problem: ControlProblem,
    prefix: str,
    dtype: Dtype,
    struct: Iterable[StructMember],
    fields: Iterable[SeriesField],
    *,
    plan: PlanLayout,
    rows: Rows,
    cost_scale: float,
) -> str:
    """Returns the text of the JSON file that describes a controller.

    `prefix` is that of its C names. `struct` lists the members of its state struct, `fields` those
    of its input struct next to x, `rows` its limits. `plan` tells where the plan is in the state
    struct. `cost_scale` is the factor by which the solver multiplies the cost of the spec.
    """
    real = dtype

    def member(name: str, kind: str, shape: tuple[int, ...]) -> dict[str, Any]:
        return {"name": name, "type": kind, "shape": list(shape)}

    nx, nu = problem.states.size, problem.controls.size
    return metadata_text(
        {
            "prefix": prefix,
            "export_sha256": OPEN,
            "dtype": dtype,
            "horizon": problem.horizon,
            "structure": plan.structure,
            "plan": {"places": list(plan.places), "step": plan.step},
            "iterations": problem.iterations,
            # a solve that fails from the previous plan starts again, with as many iterations
            "starts_again": problem.starts_again,
            "most_iterations": problem.most_iterations,
            "tolerance": problem.tolerance,
            # the solved cost is this multiple of J; so are multipliers and adjoints in the struct
            "cost_scale": cost_scale,
            "states": quantities(problem.states),
            "controls": quantities(problem.controls),
            "limits": [_limits(rows, number) for number in range(nu)],
            "in": [
                member("x", real, (nx,)),
                *(member(field.identifier, real, field.shape) for field in fields),
            ],
            "out": [
                member("u", real, (nu,)),
                member("residual", real, ()),
                member("iterations", "int32", ()),
            ],
            "struct": [
                member(m.name, real if m.kind == "real" else m.kind, m.shape) for m in struct
            ],
        }
    )


def _limits(rows: Rows, control: int) -> dict[str, Any]:
    """Returns the constant limits of the element `control` of u, and its rate limit (per sample) if
    it has one. Limits that depend on references are None.

    `before` is the index in x of the control's previous value.
    """
    row = rows.rows[control]
    limits: dict[str, Any] = {
        # limits that depend on references are not constant
        "min": None if rows.move else row.minimum,
        "max": None if rows.move else row.maximum,
        "moves": rows.move,
    }
    for rate in rows.rates:
        if rate.control == control:
            limits |= {"rate": rate.most, "before": rate.before}
    return limits


def quantities(vector: Vector) -> list[dict[str, Any]]:
    """Lists name, first index, size and unit of each quantity of a vector."""
    return [
        {
            "name": m.name,
            "first": m.first,
            "size": m.size,
            "unit": None if m.unit is None else m.unit.text,
        }
        for m in vector.members
    ]


Kind = Literal["real", "int32", "uint32", "uint8"]


@dataclass(frozen=True, slots=True)
class StructMember:
    """A scalar (shape ()) or an array of a C struct; `real` is the name of the C floating-point
    type, which the kind `real` has.
    """

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
    """Lists the members of the state struct of a solver, in order. `real` is the C floating-point
    type.

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

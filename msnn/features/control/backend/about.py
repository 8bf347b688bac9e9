"""Writes the JSON description of a generated controller: structs, vectors, solver settings."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from backends.c_language.literals import Dtype
from backends.files.export_identity import OPEN
from backends.ports.metadata import metadata_text
from compiler.jacobian.matrices import Vector
from msnn.features.control.backend.inputs import SeriesField
from msnn.features.control.backend.members import StructMember
from msnn.features.control.backend.structure.form import PlanLayout
from msnn.features.control.backend.structure.rows import Rows
from msnn.features.control.problem.optimal_control.problem import ControlProblem


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

    `struct` lists the members of its state struct, `fields` those of its input struct next to x.
    `cost_scale` is the factor by which the solver multiplies the cost of the spec.
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
    """Returns constant limits of an element of u, and its rate limit if it has one.

    `before` is the index in x of its previous value.
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

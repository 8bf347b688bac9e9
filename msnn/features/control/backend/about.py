"""Describes a generated controller as data: its structs, what its vectors hold, how it solves."""

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
    """The JSON file of a controller."""
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
            # after a plan that leads nowhere it takes as many again
            "starts_again": problem.starts_again,
            "most_iterations": problem.most_iterations,
            "tolerance": problem.tolerance,
            # of what it solves: multipliers and adjoints of the struct are so many times as large
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
    """The limits of a control, as far as they are numbers, and the place of its value before."""
    row = rows.rows[control]
    found: dict[str, Any] = {
        # limits that follow references are no numbers
        "min": None if rows.move else row.minimum,
        "max": None if rows.move else row.maximum,
        "moves": rows.move,
    }
    for rate in rows.rates:
        if rate.control == control:
            found |= {"rate": rate.most, "before": rate.before}
    return found


def quantities(vector: Vector) -> list[dict[str, Any]]:
    """The quantities of a vector with their places."""
    return [
        {
            "name": m.name,
            "first": m.first,
            "size": m.size,
            "unit": None if m.unit is None else m.unit.text,
        }
        for m in vector.members
    ]

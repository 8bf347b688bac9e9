"""Writes the JSON description of a generated Kalman filter: its structs and vectors."""

from __future__ import annotations

from typing import Any

from backends.c_language.literals import Dtype
from backends.files.export_identity import OPEN
from backends.ports.metadata import metadata_text
from compiler.jacobian.matrices import Vector
from msnn.features.control.backend.about import quantities
from msnn.features.control.backend.estimation.filter_fields import FilterField
from msnn.features.control.backend.members import StructMember


def filter_description(
    name: str,
    dtype: Dtype,
    estimated: Vector,
    *,
    states: int,
    struct: list[StructMember],
    given: tuple[FilterField, ...],
    measured: tuple[FilterField, ...],
) -> str:
    """Returns the text of the JSON file that describes a filter.

    `struct` has the members of its state struct; `given` and `measured` are the fields of the
    structs that `predict` and `correct` read. `states` counts the elements of x without parameters.
    """

    def fields(known: tuple[FilterField, ...]) -> list[dict[str, Any]]:
        return [
            {
                "name": field.identifier,
                "signal": field.name,
                "type": dtype,
                "shape": [field.size] if field.size != 1 else [],
            }
            for field in known
        ]

    size = estimated.size
    count = sum(field.size for field in measured if field.variance)
    return metadata_text(
        {
            "prefix": name,
            "export_sha256": OPEN,
            "dtype": dtype,
            "states": states,
            "estimated": quantities(estimated),
            "in": fields(given),
            "measured": fields(measured),
            "out": [
                {"name": "x", "type": dtype, "shape": [size]},
                {"name": "std", "type": dtype, "shape": [size]},
                {"name": "innovation", "type": dtype, "shape": [count]},
            ],
            "struct": [
                {
                    "name": m.name,
                    "type": dtype if m.kind == "real" else m.kind,
                    "shape": list(m.shape),
                }
                for m in struct
            ],
        }
    )

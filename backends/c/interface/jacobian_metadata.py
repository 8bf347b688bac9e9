"""Describes a Jacobian as JSON data: its vectors, and which entries are 0 or constant."""

from __future__ import annotations

from typing import Any

from backends.c.interface.jacobian_interface import JacobianInterface
from compiler.jacobian.matrices import Matrix, Vector


def jacobian_metadata(interface: JacobianInterface) -> dict[str, Any]:
    """The vectors by letter, and the entries of each matrix by row and column.

    Entries that are not listed are always 0.
    """
    found = interface.jacobian
    vectors = (found.states, found.inputs, found.outputs, found.parameters)
    return {
        "vectors": {vector.letter: _members(vector) for vector in vectors},
        "matrices": {field.matrix.name: _matrix(field.matrix) for field in interface.fields},
    }


def _members(vector: Vector) -> list[dict[str, Any]]:
    return [
        {
            "name": member.name,
            "first": member.first,
            "shape": [axis.size for axis in member.axes],
            "unit": member.unit and member.unit.text,
        }
        for member in vector.members
    ]


def _matrix(matrix: Matrix) -> dict[str, Any]:
    columns = matrix.columns.size
    places = [divmod(entry, columns) for entry in range(matrix.size)]
    entries = list(zip(places, matrix.known, matrix.fixed, strict=True))
    return {
        "rows": matrix.rows.letter,
        "columns": matrix.columns.letter,
        "constant": [[*place, known] for place, known, _ in entries if known],
        "of_parameters": [[*place] for place, known, fixed in entries if known is None and fixed],
        "computed": [[*place] for place, known, fixed in entries if known is None and not fixed],
    }

"""Lays out the input structs of a generated Kalman filter, and describes the filter as JSON."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

from backends.c_language.literals import Dtype
from backends.c_language.rendering import comment_text
from backends.files.export_identity import OPEN
from backends.ports.identifiers import c_identifier
from backends.ports.metadata import metadata_text
from compiler.ir.program import History
from compiler.ir.types import Type
from compiler.jacobian.matrices import Vector
from msnn.features.control.backend.about import StructMember, quantities
from msnn.features.control.problem.state_estimation import EstimationProblem


@dataclass(frozen=True, slots=True)
class InputRegister:
    """A shift register of past samples of an input, part of the estimated state.

    The first sample of the input fills it, if nothing else initialises it.
    """

    first: int
    """Index of its first element in the estimate."""
    count: int
    """Elements per sample."""
    length: int
    """Number of past samples."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FilterField:
    """A field of an input struct of the filter: one input or one measurement."""

    name: str
    identifier: str
    comment: str
    first: int
    """Index of its first element among all inputs, or among all measurements."""
    size: int
    window: int = 1
    """Samples per element, the current one first; samples of an element are contiguous."""
    pasts: tuple[InputRegister, ...] = ()
    """The shift registers that the first sample of this input fills."""
    variance: float = 0.0
    """Variance of the noise of each measured element; 0 for inputs."""


def input_fields(problem: EstimationProblem, estimated: Vector) -> tuple[FilterField, ...]:
    """The fields of the struct that `predict` reads, one for each input of the model.

    `estimated` is the layout of the estimate. It tells which delay lines (buffers of past samples)
    the first sample of an input fills.
    """
    taken: set[str] = set()
    return tuple(
        FilterField(
            name=member.name,
            identifier=c_identifier(member.name, taken),
            comment=_comment(member.name, member.unit and member.unit.text, member.size),
            first=member.first,
            size=member.size,
            window=Type(member.axes).window or 1,
            pasts=tuple(_pasts(problem, estimated, member.name)),
        )
        for member in problem.inputs.members
    )


def measured_fields(
    problem: EstimationProblem, given: Collection[FilterField], smallest: float
) -> tuple[tuple[FilterField, ...], tuple[FilterField, ...]]:
    """Returns the fields of the struct that `correct` reads: measurements, then inputs.

    `given` are the inputs that measured outputs read. Variances are at least `smallest`, the
    smallest normal number of the filter's type.
    """
    taken: set[str] = set()
    first = 0
    fields: list[FilterField] = []
    for measurement in problem.measured:
        node = problem.program.step[problem.program.output(measurement.value).node]
        unit = node.type.unit
        fields.append(
            FilterField(
                name=measurement.signal,
                identifier=c_identifier(measurement.signal, taken),
                comment=_comment(measurement.signal, unit and unit.text, node.type.size),
                first=first,
                size=node.type.size,
                # a variance that rounds to 0 could lead to a division by 0
                variance=max(measurement.std**2, smallest),
            )
        )
        first += node.type.size
    inputs = [
        FilterField(
            name=field.name,
            identifier=c_identifier(field.name, taken),
            comment=field.comment,
            first=field.first,
            size=field.size,
            window=field.window,
            pasts=field.pasts,
        )
        for field in given
    ]
    return tuple(fields), tuple(inputs)


def _pasts(problem: EstimationProblem, estimated: Vector, name: str) -> list[InputRegister]:
    """Lists the shift registers of past samples of the input `name`."""
    registers: list[InputRegister] = []
    for register, origin in problem.registers.items():
        if isinstance(origin, History) and origin.source == name:
            member = estimated.member(register)
            length = member.axes[-1].size
            registers.append(InputRegister(member.first, member.size // length, length))
    return registers


def _comment(name: str, unit: str | None, size: int) -> str:
    """Returns the comment of a field: name, unit and number of elements."""
    numbers = f", {size} numbers" if size > 1 else ""
    return comment_text(name + (f" [{unit}]" if unit else "") + numbers)


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

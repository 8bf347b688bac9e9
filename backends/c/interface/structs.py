"""Lays out the structs of the generated header: their fields in the order of memory."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from backends.c.interface.interface import Field, Interface, state_comment
from backends.c_lowering.state_memory import DoubledRing, PlainState

READY = (
    "4 after init or reset, and 1 more while buffers wait for their first sample, 2 more while "
    "states wait for reset; 0 where nothing was set"
)
"""Comment of the field `ready` of the state struct, which tells if the state was initialised."""

RESERVED = "reserved"
"""The only field of a struct that would otherwise be empty, which C does not allow."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StructField:
    """A field of a C struct, of type real or (`unsigned`) uint32_t: a scalar if `shape` is empty,
    otherwise an array of that shape flattened in C order.
    """

    name: str | None
    """Name in the spec; None for fields that only the generated code uses."""
    identifier: str
    shape: tuple[int, ...] = ()
    comment: str = ""
    unsigned: bool = False
    extent: str = ""
    """The number of elements by names; empty where only the number says it."""

    @property
    def size(self) -> int:
        return math.prod(self.shape)


@dataclass(frozen=True, slots=True)
class Struct:
    """A C struct type `<prefix>_<name>_t` with its comment and fields."""

    name: str
    comment: str
    fields: tuple[StructField, ...]


def structs(interface: Interface) -> tuple[Struct, ...]:
    """All struct types that the header declares, in its order: in, out, params (unless inlined),
    init, state, and jacobian if requested.
    """
    starts = [field for field, _ in interface.windows] + [f for f, _ in interface.supplied]
    # code that takes no pointer to parameters has no struct of them, whereas the other structs are
    # always declared, with a reserved field if they are empty
    parameters = Struct("params", "Trained values.", _plain(interface.parameters))
    return (
        Struct("in", "Inputs of a step.", _plain(input.field for input in interface.inputs)),
        Struct("out", outputs_text(interface.late), _plain(interface.outputs)),
        *((parameters,) if interface.takes_parameters else ()),
        Struct("init", "What reset takes: samples around the first step t0.", _plain(starts)),
        Struct("state", "The memory of one instance: plain data.", _state(interface)),
        *_jacobian(interface),
    )


def outputs_text(late: int) -> str:
    """The comment of the struct of outputs. `late` is the number of samples by which they are older
    than the inputs of their step.
    """
    return f"Outputs of a step: those of sample t-{late}." if late else "Outputs of a step."


def step_text(late: int) -> str:
    """The comment of the step function. `late` is the number of samples by which outputs are older
    than the inputs of their step.
    """
    if not late:
        return "Computes the outputs of sample t, then the states of sample t+1."
    following = f"t-{late - 1}" if late > 1 else "t"
    return f"Computes the outputs of sample t-{late}, then the states of sample {following}."


def _jacobian(interface: Interface) -> tuple[Struct, ...]:
    if interface.jacobian is None:
        return ()
    fields = tuple(
        StructField(
            name=field.matrix.name,
            identifier=field.identifier,
            shape=field.matrix.shape,
            comment=field.comment,
            extent=field.extent,
        )
        for field in interface.jacobian.fields
    )
    return (Struct("jacobian", "Slopes of one step.", fields or (_reserved(),)),)


def _plain(fields: Iterable[Field]) -> tuple[StructField, ...]:
    listed = tuple(
        StructField(
            name=field.name, identifier=field.identifier, shape=field.shape, comment=field.comment
        )
        for field in fields
    )
    return listed or (_reserved(),)


def _state(interface: Interface) -> tuple[StructField, ...]:
    fields: list[StructField] = []
    for memory in interface.states:
        name, comment = memory.state.name, state_comment(memory)
        # only a plain state has the shape of the spec: C indexes buffers by rows that overlap
        # a buffer has room for more than its state, in one row
        shape = memory.shape if isinstance(memory, PlainState) else (memory.size,)
        fields.append(
            StructField(name=name, identifier=memory.identifier, shape=shape, comment=comment)
        )
        if isinstance(memory, DoubledRing):
            place = "where the ring takes its next sample"
            fields.append(
                StructField(
                    name=None, identifier=memory.head, shape=(), comment=place, unsigned=True
                )
            )
    for input in interface.inputs:
        if input.held is not None:
            kept = "last valid value"
            fields.append(
                StructField(name=None, identifier=input.held, shape=input.field.shape, comment=kept)
            )
    if interface.has_state:
        fields.append(
            StructField(
                name=None, identifier=interface.ready, shape=(), comment=READY, unsigned=True
            )
        )
    return tuple(fields) or (_reserved(),)


def _reserved() -> StructField:
    return StructField(
        name=None, identifier=RESERVED, shape=(), comment="C allows no empty struct", unsigned=True
    )

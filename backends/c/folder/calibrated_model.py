"""Lists the variables of generated floating-point C that calibration tools can access (ASAP2)."""

from __future__ import annotations

import math
from collections.abc import Iterable

from backends.asap2.objects import (
    CalibratedModel,
    MemoryObject,
    Scale,
    Segment,
    Storage,
    Struct,
    grids,
    knots_of,
)
from backends.c.interface.interface import Field, Interface
from backends.c_language.literals import Dtype
from backends.c_lowering.state_memory import PlainState
from compiler.ir.program import Declared, Program

_STORAGES: dict[Dtype, Storage] = {"float32": "FLOAT32_IEEE", "float64": "FLOAT64_IEEE"}
_REMARKS = {
    "const": "Parameters are constants: change them in the image, or export with params: tunable.",
    "tunable": "Parameters may change between steps.",
    "calibration": "Parameters may change between steps, beside their checksum.",
    "inline": "Parameters are numbers in the code.",
}


def calibrated_model(program: Program, interface: Interface) -> CalibratedModel:
    """The description of the memory of generated C for calibration tools. Its objects are
    parameters (unless inlined), inputs, outputs, declared states and, with `params: calibration`,
    the checksum. Buffers are left out, as their samples change places.
    """
    remark = _REMARKS[interface.options.params] if interface.parameters else ""
    return CalibratedModel(
        name=program.name,
        prefix=interface.prefix,
        doc=program.doc,
        version=program.spec_hash,
        objects=tuple(_objects(program, interface)),
        remark=remark,
        segment=_segment(interface) if interface.calibrates else None,
    )


def _segment(interface: Interface) -> Segment:
    """The memory segment of the variable that holds the parameters and then their checksum
    (CRC-32). Its size in bytes counts the checksum as one real, as the compiler pads it to that
    size.
    """
    size = 4 if interface.options.dtype == "float32" else 8
    count = sum(field.size for field in interface.parameters) + 1
    # a struct is padded to its widest member: a CRC of 4 bytes after float64 takes 8 bytes
    return Segment(f"{interface.prefix}_calibration_t", interface.calibration_section, count * size)


def _objects(program: Program, interface: Interface) -> Iterable[MemoryObject]:
    storage = _STORAGES[interface.options.dtype]
    known = grids(program)
    if interface.takes_parameters:
        for field in interface.parameters:
            parameter = program.parameter(field.name)
            yield MemoryObject(
                name=field.name,
                member=field.identifier,
                struct="params",
                doc=parameter.doc,
                axes=_axes(field),
                scale=_scale(field),
                # ASAP2 has no infinity: the writer replaces it by the limits of the storage type
                low=-math.inf if parameter.minimum is None else parameter.minimum,
                high=math.inf if parameter.maximum is None else parameter.maximum,
                storage=storage,
                knots=knots_of(parameter, known),
            )
    for input in interface.inputs:
        signal = input.port.signal
        yield _measured(input.field, "in", signal.doc, signal.range, storage)
    for field in interface.outputs:
        doc, limits = program.output(field.name).doc, program.expected_range(field.name)
        yield _measured(field, "out", doc, limits, storage)
    for memory in interface.states:
        state = memory.state
        # buffers rotate: a fixed address contains another sample in each step
        if isinstance(memory, PlainState) and isinstance(state.origin, Declared):
            field = Field(
                name=state.name,
                identifier=memory.identifier,
                axes=state.axes,
                unit=state.unit,
                comment="",
            )
            yield _measured(field, "state", state.doc, state.range, storage)
    if interface.calibrates:
        yield MemoryObject(
            name="checksum",
            member="checksum",
            struct="calibration",
            doc="CRC-32 of the parameters, as they were when it was computed",
            axes=(),
            scale=Scale(""),
            # unsigned: a CRC uses all 32 bits
            low=0.0,
            high=2.0**32 - 1.0,
            storage="ULONG",
        )


def _measured(
    field: Field, struct: Struct, doc: str, limits: tuple[float, float] | None, storage: Storage
) -> MemoryObject:
    low, high = limits or (-math.inf, math.inf)
    return MemoryObject(
        name=field.name,
        member=field.identifier,
        struct=struct,
        doc=doc,
        axes=_axes(field),
        scale=_scale(field),
        low=low,
        high=high,
        storage=storage,
    )


def _axes(field: Field) -> tuple[tuple[str, int], ...]:
    return tuple((axis.name, axis.size) for axis in field.axes)


def _scale(field: Field) -> Scale:
    return Scale("" if field.unit is None else field.unit.text)

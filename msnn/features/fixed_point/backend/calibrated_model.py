"""Lists the variables of generated fixed-point C that calibration tools can read."""

from __future__ import annotations

import math
from collections.abc import Iterable

from backends.asap2.objects import CalibratedModel, MemoryObject, Scale, Storage, Struct
from compiler.ir.types import WINDOW
from msnn.features.fixed_point.backend.names import FixedNames
from msnn.features.fixed_point.integers.program import IntegerMemory, IntegerProgram, WordPort

_STORAGES: dict[int, Storage] = {16: "SWORD", 32: "SLONG", 64: "A_INT64"}


def calibrated_model(program: IntegerProgram, names: FixedNames) -> CalibratedModel:
    """Inputs, outputs and states in physical units.

    Weights are constants in the code, and buffers are omitted.
    """
    return CalibratedModel(
        name=program.name,
        prefix=names.prefix,
        doc=program.doc,
        version=program.spec_hash,
        objects=tuple(_objects(program, names)),
        remark="Parameters are numbers in the code.",
    )


def _objects(program: IntegerProgram, names: FixedNames) -> Iterable[MemoryObject]:
    word, wide = program.width.word, program.width.sum
    for entry in program.inputs:
        yield _object(entry.port, "in", names.inputs[entry.port.name], word)
    for port, _ in program.outputs:
        yield _object(port, "out", names.outputs[port.name], word)
    for memory in program.memories:
        # buffers move every step: at a fixed address a tool would see another sample each time
        if all(axis.name != WINDOW for axis in memory.axes):
            bits = wide if memory.wide else word
            yield _object(memory, "state", names.memories[memory.name], bits)


def _object(port: WordPort | IntegerMemory, struct: Struct, member: str, bits: int) -> MemoryObject:
    # a power of two: physical limits below are exact
    factor = math.ldexp(1.0, -port.fraction)
    return MemoryObject(
        name=port.name,
        member=member,
        struct=struct,
        doc=port.doc,
        axes=tuple((axis.name, axis.size) for axis in port.axes),
        scale=Scale("" if port.unit is None else port.unit.text, factor),
        low=port.low * factor,
        high=port.high * factor,
        storage=_STORAGES[bits],
    )

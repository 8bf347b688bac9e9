"""Writes the public header: types with units, ranges and places in the spec, prototypes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Protocol

from backends.c.interface.interface import Interface
from backends.c.interface.status import MEANING, SelfTestBit, StatusBit, status_macro
from backends.c.interface.structs import Struct, StructField, structs
from backends.c_language.literals import real_literal
from backends.c_language.printer import Printer
from backends.c_language.rendering import Generated, comment, render, string_literal, string_size
from backends.c_language.tree import Function
from backends.files.export_identity import OPEN
from compiler.ir.program import InvalidPolicy, Program


def header_text(
    program: Program,
    interface: Interface,
    functions: Mapping[str, Function],
    vectors: Iterable[Function],
    *,
    selftest_steps: int,
    kernels: bool,
) -> str:
    """The text of `include/<prefix>.h`. `functions` are step, init, reset and linearize by name.
    `vectors` are the functions that copy structs into vectors of the Jacobian and back.
    `selftest_steps` is the number of golden steps; `kernels`: the code calls math kernels.
    """
    printer = Printer(interface.prefix, interface.options.dtype)
    # these have a bit in the result of the self-test
    helpers = program.sample_time is not None or bool(interface.jacobian)
    return render(
        "header.h.j2",
        interface,
        "Interface",
        doc=comment(program.doc) if program.doc else "",
        **origin(program),
        # always a double: callers derive timers from it, and 0.1f is a different time
        sample_time=program.sample_time and real_literal(program.sample_time, "float64"),
        c_real="float" if interface.options.dtype == "float32" else "double",
        status=[_bit(interface, bit) for bit in step_bits(interface)],
        selftest=[
            _bit(interface, bit)
            for bit in selftest_bits(
                has_kernels=kernels, has_helpers=helpers, calibrates=interface.calibrates
            )
        ],
        selftest_checks=" and checks the arithmetic of this build",
        structs=[_struct(struct, printer) for struct in structs(interface)],
        prototypes={name: printer.prototype(function) for name, function in functions.items()},
        selftest_steps=selftest_steps,
        late=interface.late,
        calibrates=interface.calibrates,
        vector_functions=[
            {"doc": comment(function.doc), "prototype": printer.prototype(function)}
            for function in vectors
        ],
        vectors=interface.jacobian.vectors if interface.jacobian else (),
    )


class Made(Protocol):
    """A compiled program, in floating point or fixed point. `spec_hash` is the SHA-256 of its spec,
    `made_by` the tool with its version.
    """

    @property
    def spec_hash(self) -> str: ...

    @property
    def made_by(self) -> str: ...


def about_text(interface: Generated, program: Made, sample_time: str | None) -> str:
    """`src/<prefix>_about.c`: tool, spec and identity of the export, as strings in the binary.
    `sample_time` is a C literal in seconds, or None for a program without sample time.
    """
    return render("about.c.j2", interface, "Origin", **origin(program), sample_time=sample_time)


def origin(program: Made) -> dict[str, Any]:
    """Values for templates: tool, SHA-256 of the spec, and a placeholder for the SHA-256 of the
    export. Each is a dict of the C `literal` and its `size`.
    """
    return {
        "made_by": _text(program.made_by),
        "spec_sha256": _text(program.spec_hash),
        "export_sha256": _text(OPEN),
    }


def _text(text: str) -> dict[str, object]:
    literal = string_literal(text)
    return {"literal": literal, "size": string_size(text)}


def defined(macro: str, bit: int, meaning: str) -> dict[str, str]:
    """Values for the template of the header: a `comment` with the meaning of a status bit, and the
    line `#define` of its macro with its value.
    """
    return {"comment": comment(meaning), "definition": f"#define {macro} {int(bit)}U"}


def _bit(interface: Interface, bit: StatusBit | SelfTestBit) -> dict[str, str]:
    return defined(status_macro(interface.prefix, bit), bit, MEANING[bit])


def _struct(struct: Struct, printer: Printer) -> dict[str, object]:
    fields = [
        {
            "comment": comment(field.comment, "    ") if field.comment else "",
            "declaration": _declaration(field, printer),
        }
        for field in struct.fields
    ]
    return {"name": struct.name, "comment": comment(struct.comment), "fields": fields}


def _declaration(field: StructField, printer: Printer) -> str:
    type = "uint32_t" if field.unsigned else printer.real
    size = f"[{field.extent or field.size}]" if field.shape else ""
    return f"{type} {field.identifier}{size};"


_OF_POLICY: dict[InvalidPolicy, StatusBit] = {
    "flag": StatusBit.OUT_OF_RANGE | StatusBit.NOT_A_NUMBER,
    "clamp": StatusBit.CLAMPED | StatusBit.NOT_A_NUMBER,
    "hold": StatusBit.HELD | StatusBit.NOT_A_NUMBER,
    "trust": StatusBit(0),
}


def step_bits(interface: Interface) -> list[StatusBit]:
    """The status bits that step, reset and linearize of this model can return, in ascending
    order.
    """
    bits = StatusBit(0)
    for port in (*(i.port for i in interface.inputs), *(port for _, port in interface.windows)):
        bits |= _OF_POLICY[port.signal.on_invalid]
    for check in interface.checks:
        bits |= check.bit
    if interface.checks_equations:
        bits |= StatusBit.EQUATION_OUT_OF_RANGE
    if interface.has_state:
        bits |= StatusBit.UNINITIALISED
    if interface.jacobian is not None and any(
        field.matrix.perhaps_infinite for field in interface.jacobian.fields
    ):
        bits |= StatusBit.SLOPE_NOT_FINITE
    return list(bits)


def selftest_bits(*, has_kernels: bool, has_helpers: bool, calibrates: bool) -> list[SelfTestBit]:
    """The bits that the self-test of a model can return. `has_kernels`: the code calls math
    kernels. `has_helpers`: it has a sample time, or functions that copy between vectors and
    structs. `calibrates`: it has a checksum of its parameters.
    """
    there = {
        SelfTestBit.KERNEL_DIFFERS: has_kernels,
        SelfTestBit.HELPER_DIFFERS: has_helpers,
        SelfTestBit.CHECKSUM_DIFFERS: calibrates,
    }
    return [bit for bit in SelfTestBit if there.get(bit, True)]

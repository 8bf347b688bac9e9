"""Writes the C code of a unit: the generated model, an instance of it, and the FMI functions."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from backends.c.folder.file_texts import model_texts
from backends.c.folder.header_text import step_bits
from backends.c.interface.interface import Interface
from backends.c.interface.status import MEANING, StatusBit, status_macro
from backends.c_language.literals import real_literal
from backends.c_language.rendering import comment_text, render, string_literal
from backends.fmu.variable import UnitVariables, Variable, VariableKind
from backends.fmu.variables import FIRST, Weights
from compiler.ir.program import Program

Version = Literal[2, 3]
VERSIONS: tuple[Version, ...] = (2, 3)


def model_sources(program: Program, interface: Interface, weights: Weights) -> dict[str, str]:
    """The generated C of the model that both FMI versions share, file name → text. It has
    placeholders instead of the identity of the export. `weights` are physical arrays by name.
    """
    texts = model_texts(program, interface, weights)
    prefix = interface.prefix
    # sources lie in one folder of a unit: folders of an export are taken off
    sources = {p.removeprefix("src/"): text for p, text in texts.items() if p.startswith("src/")}
    return {f"{prefix}.h": texts[f"include/{prefix}.h"], **sources}


def unit_sources(
    program: Program, interface: Interface, variables: UnitVariables, version: Version, token: str
) -> dict[str, str]:
    """The C files that one FMI version adds, file name → text: instances of the model and the
    functions of FMI. `token` is the hash that sources and description share.
    """
    prefix = interface.prefix
    facts = _facts(program, interface, variables, token)
    titles = {
        f"{prefix}_fmu.h": ("instance.h.j2", "Instances in a unit of FMI"),
        f"{prefix}_fmu.c": ("instance.c.j2", "Instances in a unit of FMI"),
        f"{prefix}_fmi{version}.c": (f"fmi{version}.c.j2", f"Functions of FMI {version}.0"),
    }
    return {
        name: render(template, interface, title, "fmu", **facts)
        for name, (template, title) in titles.items()
    }


def has_slopes(interface: Interface) -> bool:
    """True if the C code has a nonempty Jacobian, so that the unit provides derivatives of outputs
    with respect to inputs.
    """
    return interface.jacobian is not None and any(f.matrix.size for f in interface.jacobian.fields)


def bits_of_steps(interface: Interface) -> list[StatusBit]:
    """The status bits that step and reset can set. The bit for infinite derivatives is left out, as
    an importer gets it when it requests derivatives.
    """
    return [bit for bit in step_bits(interface) if bit is not StatusBit.SLOPE_NOT_FINITE]


def _facts(
    program: Program, interface: Interface, variables: UnitVariables, token: str
) -> dict[str, Any]:
    starts = [variable for variable in variables.all if variable.kind.is_start]
    marks = {variable.name: i for i, variable in enumerate(starts)}
    every = program.sample_time
    multiples = "a step takes longer than 0 s"
    if every is not None:
        multiples = f"steps take whole multiples of the sample time, {every:.9g} s"
    columns = 0
    if has_slopes(interface):
        assert interface.jacobian is not None
        columns = interface.jacobian.jacobian.inputs.size
    return {
        "token": string_literal(token),
        "multiples": string_literal(multiples),
        "sample_time": "" if every is None else real_literal(every, "float64"),
        "first_fields": [_declared(interface, v) for v in variables.of(VariableKind.FIRST)],
        "starts": len(starts),
        "status_reference": variables.status_reference,
        "time_reference": variables.time_reference,
        "bits": [
            {
                "macro": status_macro(interface.prefix, bit),
                "meaning": string_literal(MEANING[bit]),
            }
            for bit in bits_of_steps(interface)
        ],
        "is_code": False,
        "has_iterations": False,
        "slopes": has_slopes(interface),
        "infinite": status_macro(interface.prefix, StatusBit.SLOPE_NOT_FINITE)
        if StatusBit.SLOPE_NOT_FINITE in step_bits(interface)
        else "",
        "columns": columns,
        "real": "Float32" if interface.options.dtype == "float32" else "Float64",
        "variables": [_row(interface, variable, marks) for variable in variables.all],
        "begin": [line for v in variables.all for line in _beginning(interface, v)],
        "fills": _fills(interface, variables, marks),
        "firsts": [
            {
                "name": comment_text(variable.name),
                "mark": marks[variable.name],
                "place": variable.place,
                "state": f"s.{variable.place.removeprefix(f'{FIRST}.')}",
            }
            for variable in variables.of(VariableKind.FIRST)
        ],
    }


def _row(interface: Interface, variable: Variable, marks: dict[str, int]) -> dict[str, Any]:
    # the functions of FMI treat both alike: what may be set before the first step, and has a mark
    # then
    kind = VariableKind.SAMPLES if variable.kind is VariableKind.FIRST else variable.kind
    return {
        "name": comment_text(variable.name),
        "first": variable.first,
        "size": variable.size,
        "kind": "START" if kind is VariableKind.SAMPLES else kind.name,
        "mark": _mark(interface, variable, marks),
        "pointer": f"{'' if variable.shape else '&'}m->{variable.place}",
    }


def _mark(interface: Interface, variable: Variable, marks: dict[str, int]) -> str:
    if variable.kind.is_start:
        return f"{marks[variable.name]}U"
    if (
        variable.kind in (VariableKind.INPUT, VariableKind.OUTPUT)
        and interface.jacobian is not None
    ):
        found = interface.jacobian.jacobian
        vector = found.inputs if variable.kind is VariableKind.INPUT else found.outputs
        # the mark of an input or output is its place in the Jacobian, for directional derivatives
        for member in vector.members:
            if member.name == variable.name:
                return f"{member.first}U"
    return "NO_MARK"


def _declared(interface: Interface, variable: Variable) -> str:
    size = f"[{variable.size}]" if variable.shape else ""
    return f"{interface.prefix}_real {variable.place.removeprefix(f'{FIRST}.')}{size};"


def _beginning(interface: Interface, variable: Variable) -> list[str]:
    """Lines of C that set the start values of an input, or of samples before the first step. Empty
    for other variables, and for values of 0, which memory has anyway.
    """
    if variable.kind not in (VariableKind.INPUT, VariableKind.SAMPLES) or not np.any(
        variable.start
    ):
        return []
    # all samples begin with the same number: that nearest to 0 within the range
    value = real_literal(float(variable.start[0]), interface.options.dtype)
    if not variable.shape:
        return [f"m->{variable.place} = {value};"]
    return [
        f"for (uint32_t i = 0U; i < {variable.size}U; i++) {{",
        f"    m->{variable.place}[i] = {value};",
        "}",
    ]


def _fills(
    interface: Interface, variables: UnitVariables, marks: dict[str, int]
) -> list[dict[str, Any]]:
    """Variables of the template, one for each argument of `reset` with samples of an input: C lines
    that fill it with the input's current value. They run if the importer did not set the argument.
    `marks` are the numbers of the variables that can be set before the first step, by name.
    """
    inputs = {variable.place: variable for variable in variables.of(VariableKind.INPUT)}
    samples = {variable.place: variable for variable in variables.of(VariableKind.SAMPLES)}
    given = {input.port.signal.name: input for input in interface.inputs}
    found: list[dict[str, Any]] = []
    for field, port in interface.windows:
        input = given.get(port.signal.name)
        # an encoder's window of a signal that is no input must be set by the importer
        if input is None:
            continue
        to = samples[f"x0.{field.identifier}"]
        source = inputs[f"u.{input.field.identifier}"]
        # samples of one element stand in a row, as time is the last axis: `length` in the window,
        # `ahead` in the input, of which the first is its sample now
        length = 1 if port.first == port.last else field.shape[-1]
        ahead = 1 if input.port.first == input.port.last else input.field.shape[-1]
        target = f"m->{to.place}" if to.shape else f"(&m->{to.place})"
        value = f"m->{source.place}" if source.shape else f"(&m->{source.place})"
        lines = [
            f"for (uint32_t i = 0U; i < {to.size}U; i++) {{",
            f"    {target}[i] = {value}[{_scaled(f'i / {length}U', length, ahead)}];",
            "}",
        ]
        fact = {"name": comment_text(to.name), "mark": marks[to.name], "lines": lines}
        found.append(fact)
    return found


def _scaled(element: str, length: int, ahead: int) -> str:
    index = element if length > 1 else "i"
    return f"({index}) * {ahead}U" if ahead > 1 else index

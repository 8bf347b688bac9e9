"""Describes the FMU of a controller or an estimator, and writes it."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from backends.c_language.literals import Dtype, real_literal
from backends.c_language.rendering import GeneratedNames, comment_text, render, string_literal
from backends.fmu.sources import Version
from backends.fmu.variable import UnitFacts, UnitVariables, Variable, VariableKind
from backends.fmu.write_fmu import write_units
from compiler.ir.program import Program


@dataclass(frozen=True, slots=True, kw_only=True)
class Fill:
    """A shift register of an input's past samples in the estimate, and the input whose first sample
    fills it.
    """

    register: str
    source: str
    """Place of the input's first number."""
    first: int
    """Place of the register's first number among the first numbers of all states."""
    size: int
    length: int
    """Samples that it keeps."""
    window: int
    """Samples that are given of the input, the newest first."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OnlineUnit:
    """The contents of an FMU of a controller (`kind` controller) or an estimator (filter or
    window).
    """

    kind: Literal["controller", "filter", "window"]
    prefix: str
    """Of its C."""
    dtype: Dtype
    members: Sequence[str]
    """What an instance keeps beside its own struct and what came out: declarations in C."""
    variables: UnitVariables
    """Each `place` is that of its first number."""
    meanings: Mapping[int, str]
    """Of the status of a step."""
    told: Mapping[str, str]
    """Names of those statuses that are warnings in the log, and what is told."""
    takes_inputs: bool = True
    fills: Sequence[Fill] = ()


def write_online_unit(
    program: Program,
    unit: OnlineUnit,
    sources: Mapping[str, str],
    folder: Path,
    platforms: Collection[str] = (),
    *,
    identity: str,
) -> tuple[Path, ...]:
    """Writes the FMUs of FMI 2.0 and 3.0 to `folder`; returns their paths. Bytes and errors are
    those of `write_units`.

    `program` is that of the problem, `sources` are the generated C files by name, with this
    `identity` (a hash). `platforms` are compiled for in addition to this machine.
    """
    meanings = "; ".join(f"{code}: {meaning}" for code, meaning in unit.meanings.items())
    facts = UnitFacts(
        model=program.name,
        made_by=program.made_by,
        identity=identity,
        prefix=unit.prefix,
        doc=" ".join(program.doc.split()),
        dtype=unit.dtype,
        sample_time=program.sample_time,
        variables=unit.variables,
        labels={d.name: d.labels for d in program.dimensions if d.labels},
        depends=None,
        status_doc=f"of the last step: {meanings}",
    )

    def added(version: Version, token: str) -> dict[str, str]:
        return _unit_sources(program, unit, version, token)

    return write_units(facts, sources, added, folder, platforms)


def _unit_sources(
    program: Program, unit: OnlineUnit, version: Version, token: str
) -> dict[str, str]:
    named = GeneratedNames(program.name, unit.prefix)
    facts = _facts(program, unit, token)
    titles = {
        f"{unit.prefix}_fmu.h": ("online.h.j2", "Instances in a unit of FMI"),
        f"{unit.prefix}_fmu.c": (f"{unit.kind}.c.j2", "Instances in a unit of FMI"),
        f"{unit.prefix}_fmi{version}.c": (f"fmi{version}.c.j2", f"Functions of FMI {version}.0"),
    }
    return {
        name: render(template, named, title, "fmu", **facts)
        for name, (template, title) in titles.items()
    }


def _facts(program: Program, unit: OnlineUnit, token: str) -> dict[str, Any]:
    variables = unit.variables
    firsts = variables.of(VariableKind.FIRST)
    marks = {variable.name: i for i, variable in enumerate(firsts)}
    every = program.sample_time
    assert every is not None, "a problem has a sample time"
    begins = [sum(v.size for v in firsts[:number]) for number in range(len(firsts))]
    return {
        "token": string_literal(token),
        "multiples": string_literal(
            f"steps take whole multiples of the sample time, {every:.9g} s"
        ),
        "sample_time": real_literal(every, "float64"),
        "members": unit.members,
        "takes_inputs": unit.takes_inputs,
        # NAN of <math.h> is a float
        "nan": "NAN" if unit.dtype == "float32" else "(double)NAN",
        "first_size": sum(variable.size for variable in firsts),
        "firsts": [
            {
                "name": comment_text(variable.name),
                "mark": marks[variable.name],
                "begin": begin,
                "end": begin + variable.size,
            }
            for variable, begin in zip(firsts, begins, strict=True)
        ],
        "fills": [
            {
                "mark": marks[f"start.{fill.register}"],
                "name": comment_text(fill.register),
                "begin": fill.first,
                "end": fill.first + fill.size,
                "value": f"(&m->{fill.source})[{_element(fill)}]",
            }
            for fill in unit.fills
        ],
        "starts": len(firsts),
        "status_reference": variables.status_reference,
        "time_reference": variables.time_reference,
        "has_iterations": variables.iterations is not None,
        "iterations_reference": variables.iterations_reference,
        "bits": [
            {
                "macro": f"(uint32_t){unit.prefix.upper()}_{name}",
                "meaning": string_literal(meaning),
            }
            for name, meaning in unit.told.items()
        ],
        "is_code": True,
        "slopes": False,
        "real": "Float32" if unit.dtype == "float32" else "Float64",
        "variables": [_row(variable, marks) for variable in variables.all],
        "begin": [line for v in variables.all for line in _beginning(unit.dtype, v)],
    }


def _element(fill: Fill) -> str:
    """The C expression of the index of the input's element that fills element i of the estimate."""
    if fill.size == fill.length:
        return "0"
    # element i of a register is a past sample of the element that its row belongs to
    return f"((i - {fill.first}U) / {fill.length}U) * {fill.window}U"


def _row(variable: Variable, marks: Mapping[str, int]) -> dict[str, Any]:
    is_start = variable.kind is VariableKind.FIRST
    return {
        "name": comment_text(variable.name),
        "first": variable.first,
        "size": variable.size,
        "kind": "START" if is_start else variable.kind.name,
        "mark": f"{marks[variable.name]}U" if is_start else "NO_MARK",
        "pointer": f"&m->{variable.place}",
    }


def _beginning(dtype: Dtype, variable: Variable) -> list[str]:
    """C statements that set the nonzero initial values of a variable; none for results."""
    if variable.kind.is_result or not np.any(variable.start):
        return []
    pointer = f"(&m->{variable.place})"
    return [
        f"{pointer}[{number}] = {real_literal(float(value), dtype)};"
        for number, value in enumerate(variable.start)
        if value != 0.0
    ]


def valid_numbers(range: tuple[float, float] | None, size: int, dtype: Dtype) -> NDArray[Any]:
    """An array (size) of the number nearest to 0 within a range; None is no limit."""
    low, high = (-np.inf, np.inf) if range is None else range
    # FMI wants starts within `min` and `max`
    return np.full(size, min(max(0.0, low), high), dtype)

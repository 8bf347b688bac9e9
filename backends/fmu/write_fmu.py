"""Writes a model as Functional Mock-up Units, one archive each for FMI 2.0 and 3.0."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from functools import partial
from pathlib import Path

from numpy.typing import ArrayLike

from backends.c.interface.interface import Interface, c_interface
from backends.c.interface.status import MEANING
from backends.c_lowering.options import COptions
from backends.files.atomic_write import write_text
from backends.files.export_identity import identity_of, with_identity
from backends.files.readme import one_line, readme_text
from backends.fmu.description.facts import UnitFacts
from backends.fmu.description.variable import UnitVariables, Variable, VariableKind
from backends.fmu.description.variables import unit_variables
from backends.fmu.sources import bits_of_steps, has_slopes, model_sources, unit_sources
from backends.fmu.write_units import write_headers, write_units
from compiler.interpreter.interpreter import physical_weights
from compiler.ir.program import Program


def write_fmu(
    program: Program,
    weights: Mapping[str, ArrayLike],
    folder: Path,
    options: COptions,
    platforms: Collection[str] = (),
) -> tuple[Path, ...]:
    """Writes `<prefix>_fmi2.fmu`, `<prefix>_fmi3.fmu`, FMI headers and a README; returns paths.

    `program` is in step form. Bytes and errors are those of `write_units`. Also raises ValueError,
    like `write_c`.
    """
    interface = c_interface(program, options)
    physical = physical_weights(program, weights)
    variables = unit_variables(program, interface, physical)
    sources = model_sources(program, interface, physical)
    units = write_units(
        _facts(program, interface, variables, identity_of(sources)),
        with_identity(sources),
        partial(unit_sources, program, interface, variables),
        folder,
        platforms,
    )
    readme = readme_text(
        "fmu",
        model=one_line(program.name),
        prefix=interface.prefix,
        platforms=", ".join(platforms),
    )
    return (*units, *write_headers(folder), write_text(folder / "README.md", readme))


def _facts(
    program: Program, interface: Interface, variables: UnitVariables, identity: str
) -> UnitFacts:
    return UnitFacts(
        model=program.name,
        made_by=program.made_by,
        identity=identity,
        prefix=interface.prefix,
        doc=" ".join(program.doc.split()),
        dtype=interface.options.dtype,
        sample_time=program.sample_time,
        variables=variables,
        labels={d.name: d.labels for d in program.dimensions if d.labels},
        depends=_depends(interface, variables) if has_slopes(interface) else None,
        status_doc=_status_doc(interface),
    )


def _status_doc(interface: Interface) -> str:
    bits = "; ".join(f"{int(bit)}: {MEANING[bit]}" for bit in bits_of_steps(interface))
    return f"of the last step: the sum of {bits}" if bits else "of the last step: always 0"


def _depends(interface: Interface, variables: UnitVariables) -> dict[str, Sequence[Variable]]:
    """The inputs on which each output depends, from the sparsity of D (outputs, inputs)."""
    assert interface.jacobian is not None
    found = interface.jacobian.jacobian
    direct = next(matrix for matrix in found.matrices if matrix.name == "D")
    inputs = {variable.name: variable for variable in variables.of(VariableKind.INPUT)}
    depends: dict[str, Sequence[Variable]] = {}
    for row in found.outputs.members:
        columns: list[Variable] = []
        for column in found.inputs.members:
            places = (
                (row.first + i) * found.inputs.size + column.first + j
                for i in range(row.size)
                for j in range(column.size)
            )
            # element (i, j) of D, row after row, of one output's numbers by one input's
            # a slope that is not known to be 0 is a dependency
            if any(direct.known[place] != 0.0 for place in places):
                columns.append(inputs[column.name])
        depends[row.name] = columns
    return depends

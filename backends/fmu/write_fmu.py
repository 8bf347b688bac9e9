"""Writes a model as Functional Mock-up Units of FMI 2.0 and 3.0: an archive each."""

from __future__ import annotations

import hashlib
import uuid
from collections.abc import Mapping, Sequence
from pathlib import Path

from numpy.typing import ArrayLike

from backends.c.interface.interface import Interface, c_interface
from backends.c.interface.status import MEANING
from backends.c_lowering.options import COptions
from backends.files.atomic_write import write_bytes, write_text
from backends.files.c_compiler import CompilerMissingError, find_compiler
from backends.files.readme import one_line, readme_text
from backends.fmu import description2, description3
from backends.fmu.archive import archive
from backends.fmu.binary import HEADERS, binary, this_platform
from backends.fmu.facts import UnitFacts
from backends.fmu.sources import (
    VERSIONS,
    Version,
    bits_of_steps,
    has_slopes,
    model_sources,
    unit_sources,
)
from backends.fmu.variable import Kind, Variable, Variables
from backends.fmu.variables import unit_variables
from compiler.interpreter.interpreter import physical_weights
from compiler.ir.program import Program

_HEADERS_OF: dict[Version, tuple[str, ...]] = {
    2: ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"),
    3: ("fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h"),
}


def write_fmu(
    program: Program, weights: Mapping[str, ArrayLike], folder: Path, options: COptions
) -> tuple[Path, ...]:
    """Writes `<prefix>_fmi2.fmu`, `<prefix>_fmi3.fmu`, FMI's headers and a README; their paths.

    `program` is in step form. The same arguments give the same bytes, but for the binary that the
    compiler of this machine makes; without a compiler, units have their sources alone. Raises
    CompilerFailedError for a compiler that rejects them, ValueError and OSError as `write_c` does.
    """
    interface = c_interface(program, options)
    physical = physical_weights(program, weights)
    variables = unit_variables(program, interface, physical)
    facts = _facts(program, interface, variables)
    model = model_sources(program, interface, physical)
    compiler = _compiler()
    written: list[Path] = []
    for version in VERSIONS:
        plain = unit_sources(program, interface, variables, version, "")
        token = _token(facts, version, {**model, **plain})
        sources = {**model, **unit_sources(program, interface, variables, version, token)}
        files = _files(facts, version, sources, token)
        platform = this_platform()
        if compiler is not None and platform is not None:
            files[platform.path(version, facts.prefix)] = binary(sources, compiler)
        path = folder / f"{facts.prefix}_fmi{version}.fmu"
        written.append(write_bytes(path, archive(files)))
    for header in sorted(name for names in _HEADERS_OF.values() for name in names):
        text = (HEADERS / header).read_text(encoding="utf-8")
        written.append(write_text(folder / "include" / header, text))
    readme = readme_text("fmu", model=one_line(program.name), prefix=facts.prefix)
    return (*written, write_text(folder / "README.md", readme))


def _compiler() -> Sequence[str] | None:
    try:
        return find_compiler()
    except CompilerMissingError:
        return None


def _facts(program: Program, interface: Interface, variables: Variables) -> UnitFacts:
    return UnitFacts(
        model=program.name,
        prefix=interface.prefix,
        doc=" ".join(program.doc.split()),
        dtype=interface.options.dtype,
        sample_time=program.sample_time,
        variables=variables,
        labels={d.name: d.labels for d in program.dimensions if d.labels},
        depends=_depends(interface, variables) if has_slopes(interface) else None,
        status={MEANING[bit]: int(bit) for bit in bits_of_steps(interface)},
    )


def _depends(interface: Interface, variables: Variables) -> dict[str, Sequence[Variable]]:
    """By the pattern of D, whose rows are outputs and whose columns are inputs."""
    assert interface.jacobian is not None
    found = interface.jacobian.jacobian
    direct = next(matrix for matrix in found.matrices if matrix.name == "D")
    inputs = {variable.name: variable for variable in variables.of(Kind.INPUT)}
    depends: dict[str, Sequence[Variable]] = {}
    for row in found.outputs.members:
        columns: list[Variable] = []
        for column in found.inputs.members:
            places = (
                (row.first + i) * found.inputs.size + column.first + j
                for i in range(row.size)
                for j in range(column.size)
            )
            if any(direct.known[place] != 0.0 for place in places):
                columns.append(inputs[column.name])
        depends[row.name] = columns
    return depends


def _files(
    facts: UnitFacts, version: Version, sources: Mapping[str, str], token: str
) -> dict[str, bytes]:
    """Everything in the archive but the binary, by path."""
    compiled = sorted(name for name in sources if name.endswith(".c"))
    texts = {f"sources/{name}": text for name, text in sources.items()}
    if version == 2:
        texts["modelDescription.xml"] = description2.description_text(facts, compiled, token)
    else:
        texts["modelDescription.xml"] = description3.description_text(facts, token)
        texts["sources/buildDescription.xml"] = description3.build_text(facts.prefix, compiled)
    texts["documentation/licenses/license.txt"] = _licence(version)
    return {path: text.encode("utf-8") for path, text in texts.items()}


def _licence(version: Version) -> str:
    """The words of the README, and the licence that stands in FMI's headers."""
    header = (HEADERS / _HEADERS_OF[version][0]).read_text(encoding="utf-8")
    begin = header.index("Copyright (C)")
    terms = header[begin : header.index("*/", begin)].rstrip()
    own = (
        "The sources and descriptions in this unit were generated for you: they are yours,\n"
        "without conditions. The binary was compiled from them and from the headers of FMI:\n\n"
    )
    return f"{own}{terms}\n"


def _token(facts: UnitFacts, version: Version, sources: Mapping[str, str]) -> str:
    """An identifier of what the unit computes and shows: another model has another one."""
    digest = hashlib.sha256()
    for path, data in sorted(_files(facts, version, sources, "").items()):
        digest.update(f"{path}\n{len(data)}\n".encode())
        digest.update(data)
    return f"{{{uuid.UUID(bytes=digest.digest()[:16])}}}"

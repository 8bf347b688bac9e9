"""Writes Functional Mock-up Units of FMI 2.0 and 3.0: an archive each, and their headers."""

from __future__ import annotations

import hashlib
import io
import uuid
import zipfile
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path

from numpy.typing import ArrayLike

from backends.c.interface.interface import Interface, c_interface
from backends.c.interface.status import MEANING
from backends.c_lowering.options import COptions
from backends.files.atomic_write import write_bytes, write_text
from backends.files.c_compiler import CompilerMissingError, find_compiler
from backends.files.export_identity import identity_of, with_identity
from backends.files.text_templates import one_line, readme_text
from backends.fmu import model_description
from backends.fmu.binary import HEADERS, PLATFORMS, Platform, binary, this_platform, zig_compiler
from backends.fmu.sources import (
    VERSIONS,
    Version,
    bits_of_steps,
    has_slopes,
    model_sources,
    unit_sources,
)
from backends.fmu.variable import UnitFacts, UnitVariables, Variable, VariableKind
from backends.fmu.variables import unit_variables
from compiler.interpreter.interpreter import physical_weights
from compiler.ir.program import Program


def write_fmu(
    program: Program,
    weights: Mapping[str, ArrayLike],
    folder: Path,
    options: COptions,
    platforms: Collection[str] = (),
) -> tuple[Path, ...]:
    """Writes `<prefix>_fmi2.fmu`, `<prefix>_fmi3.fmu`, FMI headers and a README to `folder`;
    returns their paths.

    `program` is in step form; `weights` are physical arrays by name, and a missing one is the
    initial value. The units contain a binary for this machine if it has a compiler, and for
    `platforms`, FMI 3.0 names of systems, for which zig must be installed. Raises ValueError for a
    program in window form or weights of a wrong shape, CompilerFailedError for a compiler that
    rejects the sources, and OSError.
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
    """By name of output: the inputs on which it depends in the same step. These are the columns of
    the matrix D (outputs, inputs) of the Jacobian with an element that is no structural zero.
    """
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


_HEADERS_OF: dict[Version, tuple[str, ...]] = {
    2: ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"),
    3: ("fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h"),
}


def write_units(
    facts: UnitFacts,
    model: Mapping[str, str],
    unit: Callable[[Version, str], Mapping[str, str]],
    folder: Path,
    platforms: Collection[str] = (),
) -> tuple[Path, ...]:
    """Writes `<prefix>_fmi2.fmu` and `<prefix>_fmi3.fmu` to `folder`; returns their paths.

    `model` are the sources that both FMI versions share, file name → text. `unit(version, token)`
    gives those of one version. The same arguments give the same bytes, except for the binary from
    this machine's compiler; without a compiler, units contain only sources. zig, which must be
    installed, compiles for other `platforms`, given by their FMI 3.0 names. Raises
    CompilerFailedError for a compiler that rejects the sources, and OSError.
    """
    compilers = _compilers(platforms)
    written: list[Path] = []
    for version in VERSIONS:
        # the token is of the texts without one: it stands in them
        token = _token(facts, version, {**model, **unit(version, "")})
        sources = {**model, **unit(version, token)}
        files = _files(facts, version, sources, token)
        for platform, compiler in compilers.items():
            # FMI 2.0 has no name for some machines: their unit has sources alone
            place = platform.path(version, facts.prefix)
            if place is not None:
                files[place] = binary(sources, compiler, place.rpartition("/")[2])
        path = folder / f"{facts.prefix}_fmi{version}.fmu"
        written.append(write_bytes(path, archive(files)))
    return tuple(written)


def write_headers(folder: Path) -> tuple[Path, ...]:
    """Writes the FMI headers to `include/` in the folder; returns their paths. Raises OSError."""
    return tuple(
        write_text(folder / "include" / name, (HEADERS / name).read_text(encoding="utf-8"))
        for name in sorted(name for names in _HEADERS_OF.values() for name in names)
    )


def _compilers(platforms: Collection[str]) -> dict[Platform, Sequence[str]]:
    """The compiler command of each platform for which a binary is made: this machine, if it has a
    compiler, and `platforms`, for which zig must be installed.
    """
    here = this_platform()
    found: dict[Platform, Sequence[str]] = {}
    if here is not None:
        # without a compiler here the sources are the unit
        with suppress(CompilerMissingError):
            found[here] = find_compiler()
    for name, platform in PLATFORMS.items():
        if name in platforms and name not in {known.fmi3 for known in found}:
            found[platform] = zig_compiler(platform)
    return found


def _files(
    facts: UnitFacts, version: Version, sources: Mapping[str, str], token: str
) -> dict[str, bytes]:
    """All files of the archive except the binaries, path → bytes. `token` is the hash that sources
    and description share.
    """
    compiled = sorted(name for name in sources if name.endswith(".c"))
    texts = {f"sources/{name}": text for name, text in sources.items()}
    if version == 2:
        texts["modelDescription.xml"] = model_description.fmi2_description(facts, compiled, token)
    else:
        texts["modelDescription.xml"] = model_description.fmi3_description(facts, token)
        texts["sources/buildDescription.xml"] = model_description.build_text(facts.prefix, compiled)
    texts["documentation/licenses/license.txt"] = _licence(version)
    # archives have bytes: line ends stay as they are on every system
    return {path: text.encode("utf-8") for path, text in texts.items()}


def _licence(version: Version) -> str:
    """The text of the licence file: a statement about generated code, and the licence of the FMI
    headers.
    """
    header = (HEADERS / _HEADERS_OF[version][0]).read_text(encoding="utf-8")
    # the licence of the headers must go with what is compiled from them
    begin = header.index("Copyright (C)")
    terms = header[begin : header.index("*/", begin)].rstrip()
    own = (
        "The sources and descriptions in this unit were generated for you: they are yours,\n"
        "without conditions. The binary was compiled from them and from the headers of FMI:\n\n"
    )
    return f"{own}{terms}\n"


def _token(facts: UnitFacts, version: Version, sources: Mapping[str, str]) -> str:
    """A hash of the files of a unit, made from texts with an empty token, as a GUID in braces.
    Importers compare it in the sources and the description.
    """
    digest = hashlib.sha256()
    for path, data in sorted(_files(facts, version, sources, "").items()):
        # lengths too, so that no two lists of files give the same bytes
        digest.update(f"{path}\n{len(data)}\n".encode())
        digest.update(data)
    # a GUID in braces, as FMI 2.0 writes it
    return f"{{{uuid.UUID(bytes=digest.digest()[:16])}}}"


_DATE = (1980, 1, 1, 0, 0, 0)
"""The earliest date that ZIP supports, used for all files of a unit."""

BINARIES = "binaries/"

_UNIX = 3
_FILE, _PROGRAM = 0o100644, 0o100755


def archive(files: Mapping[str, bytes]) -> bytes:
    """The bytes of a ZIP archive of files (path → bytes), in the order of paths and with a fixed
    date, so that the same files give the same bytes.
    """
    found = io.BytesIO()
    with zipfile.ZipFile(found, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as packed:
        for path in sorted(files):
            entry = zipfile.ZipInfo(path, _DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED
            # extractors take permission bits from systems that have them; binaries must be runnable
            entry.create_system = _UNIX
            mode = _PROGRAM if path.startswith(BINARIES) else _FILE
            entry.external_attr = mode << 16
            packed.writestr(entry, files[path], compresslevel=9)
    return found.getvalue()


def holds_binary(path: Path) -> bool:
    """True if the unit in this file contains a compiled binary. Raises BadZipFile and OSError."""
    with zipfile.ZipFile(path) as packed:
        return any(name.startswith(BINARIES) for name in packed.namelist())

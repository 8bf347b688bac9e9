"""Writes the archives of a unit, one for each version of FMI, and the FMI headers."""

from __future__ import annotations

import hashlib
import uuid
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from backends.files.atomic_write import write_bytes, write_text
from backends.files.c_compiler import CompilerMissingError, find_compiler
from backends.fmu.archive import archive
from backends.fmu.binary import HEADERS, PLATFORMS, Platform, binary, this_platform
from backends.fmu.description import description2, description3
from backends.fmu.description.facts import UnitFacts
from backends.fmu.sources import VERSIONS, Version
from backends.fmu.zig import zig_compiler

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
    """Writes `<prefix>_fmi2.fmu` and `<prefix>_fmi3.fmu`; returns their paths.

    `model` are the sources that both versions share. `unit` adds those of one version with a given
    token; both map file names to texts. The same arguments give the same bytes, except for the
    binary from this machine's compiler; without a compiler, units contain only sources. zig, which
    must be installed, compiles for other `platforms`, given by their FMI 3.0 names. Raises
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
    """Writes `include/` with the FMI headers; returns their paths."""
    return tuple(
        write_text(folder / "include" / name, (HEADERS / name).read_text(encoding="utf-8"))
        for name in sorted(name for names in _HEADERS_OF.values() for name in names)
    )


def _compilers(platforms: Collection[str]) -> dict[Platform, Sequence[str]]:
    """The compiler of each platform; this machine's own compiler serves its own platform."""
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
    """All files of the archive except the binary, by path."""
    compiled = sorted(name for name in sources if name.endswith(".c"))
    texts = {f"sources/{name}": text for name, text in sources.items()}
    if version == 2:
        texts["modelDescription.xml"] = description2.description_text(facts, compiled, token)
    else:
        texts["modelDescription.xml"] = description3.description_text(facts, token)
        texts["sources/buildDescription.xml"] = description3.build_text(facts.prefix, compiled)
    texts["documentation/licenses/license.txt"] = _licence(version)
    # archives have bytes: line ends stay as they are on every system
    return {path: text.encode("utf-8") for path, text in texts.items()}


def _licence(version: Version) -> str:
    """A statement about generated code, and the licence text of the FMI headers."""
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
    """A hash of all files of the unit, as a GUID; different models have different tokens."""
    digest = hashlib.sha256()
    for path, data in sorted(_files(facts, version, sources, "").items()):
        # lengths too, so that no two lists of files give the same bytes
        digest.update(f"{path}\n{len(data)}\n".encode())
        digest.update(data)
    # a GUID in braces, as FMI 2.0 writes it
    return f"{{{uuid.UUID(bytes=digest.digest()[:16])}}}"

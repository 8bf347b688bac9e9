"""Writes the archives of a unit, one for each version of FMI, and the headers beside them."""

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
    """Writes `<prefix>_fmi2.fmu` and `<prefix>_fmi3.fmu`; their paths.

    `model` are sources that both versions share, `unit` adds those of a version that has a token,
    all by names of files in one folder. The same arguments give the same bytes, but for the binary
    that the compiler of this machine makes; without one, units have their sources alone. Those for
    other `platforms`, by their names in FMI 3.0, are made by zig, which must be there. Raises
    CompilerFailedError for a compiler that rejects them, and OSError.
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
    """Writes `include/` with the headers of FMI; their paths."""
    return tuple(
        write_text(folder / "include" / name, (HEADERS / name).read_text(encoding="utf-8"))
        for name in sorted(name for names in _HEADERS_OF.values() for name in names)
    )


def _compilers(platforms: Collection[str]) -> dict[Platform, Sequence[str]]:
    """The compiler of each platform: this machine's own compiler for its own, if it has one."""
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
    """Everything in the archive but the binary, by path."""
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
    """The words of the README, and the licence that stands in FMI's headers."""
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
    """An identifier of what the unit computes and shows: another model has another one."""
    digest = hashlib.sha256()
    for path, data in sorted(_files(facts, version, sources, "").items()):
        # lengths too, so that no two lists of files give the same bytes
        digest.update(f"{path}\n{len(data)}\n".encode())
        digest.update(data)
    # a GUID in braces, as FMI 2.0 writes it
    return f"{{{uuid.UUID(bytes=digest.digest()[:16])}}}"

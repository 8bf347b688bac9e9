"""Units get binaries for other machines by zig, with FMI's functions and no others to be called."""

from __future__ import annotations

import re
import struct
import zipfile
from pathlib import Path
from typing import get_args

import pytest

from backends.fmu.binary import HEADERS, PLATFORMS
from msnn.errors.failures import MissingExtraError
from msnn.exports.export import plan_exports, write_export
from msnn.exports.target import Written
from msnn.model.load import load_model
from msnn.model.weights.weights_file import initial_weights
from msnn.packages import OptionalPackage
from spec_schema.diagnostics.diagnostic import Findings, SpecError
from spec_schema.sections.exports import UnitPlatform
from tests.conditions import require_package

LINKERS_OWN = {"__dso_handle", "_mh_dylib_header"}
"""What zig's linker defines in a dylib."""
OF_WINDOWS = {f"api-ms-win-crt-{part}-l1-1-0.dll" for part in ("heap", "string")}
"""Parts of Windows' C library: memory and texts."""
SPEC = """
msnn: 1
name: plant
sample_time: 0.1 s
inputs: {u: {}}
states: {x: {next: 0.9 * x + tanh(u), init: 0}}
outputs: {y: x}
export: {fmu: {platforms: [x86_64-windows, aarch64-darwin]}}
"""


def exported(folder: Path) -> Written:
    path = folder / "plant.msnn.yaml"
    path.write_text(SPEC, encoding="utf-8")
    (plan,) = plan_exports(load_model(path), ["fmu"], Findings())
    return write_export(plan, initial_weights(plan.program), folder / "out")


def test_the_platforms_of_the_spec_are_those_that_are_known() -> None:
    assert set(get_args(UnitPlatform)) == set(PLATFORMS)


def test_windows_and_macos_have_the_functions_of_fmi(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    require_package("ziglang", "make setup")
    monkeypatch.setenv("CC", "no-such-compiler")  # this machine's binary is tested elsewhere
    archives = sorted(path for path in exported(tmp_path).files if path.suffix == ".fmu")
    second, third = (binaries(path) for path in archives)
    page = (tmp_path / "out" / "README.md").read_text(encoding="utf-8")
    assert "and those for x86_64-windows, aarch64-darwin" in page
    assert set(second) == {"win64/plant.dll"}  # FMI 2.0 has no name for aarch64
    assert set(third) == {"x86_64-windows/plant.dll", "aarch64-darwin/plant.dylib"}
    assert names_in_dll(second["win64/plant.dll"]) == defined(archives[0], 2)
    assert names_in_dll(third["x86_64-windows/plant.dll"]) == defined(archives[1], 3)
    assert libraries_of_dll(second["win64/plant.dll"]) == OF_WINDOWS
    dylib = third["aarch64-darwin/plant.dylib"]
    assert names_in_dylib(dylib) - LINKERS_OWN == defined(archives[1], 3)
    assert libraries_of(dylib) == ["@rpath/plant.dylib", "/usr/lib/libSystem.B.dylib"]
    assert oldest_system(dylib) == 11
    assert b"msnn-fmu-" not in dylib + second["win64/plant.dll"], "a folder of this build"


def test_without_zig_other_platforms_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(OptionalPackage, "is_installed", False)
    with pytest.raises(MissingExtraError) as caught:
        exported(tmp_path)
    assert "compiles units for x86_64-windows, aarch64-darwin" in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_an_unknown_platform_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "plant.msnn.yaml"
    path.write_text(SPEC.replace("x86_64-windows", "windows"), encoding="utf-8")
    with pytest.raises(SpecError) as caught:
        load_model(path)
    assert "x86_64-windows" in str(caught.value.diagnostics)


def binaries(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as archive:
        return {
            name.removeprefix("binaries/"): archive.read(name)
            for name in archive.namelist()
            if name.startswith("binaries/")
        }


def defined(path: Path, version: int) -> set[str]:
    """The functions of FMI that a unit's source defines, each declared by FMI's header."""
    with zipfile.ZipFile(path) as archive:
        source = archive.read(f"sources/plant_fmi{version}.c").decode()
    header = (HEADERS / f"fmi{version}Functions.h").read_text(encoding="utf-8")
    found = set(re.findall(rf"^[a-z]\w*[ \w*]* \*?(fmi{version}\w+)\(", source, re.MULTILINE))
    assert f"fmi{version}DoStep" in found
    assert all(re.search(rf"\b{name};", header) for name in found)
    return found


def names_in_dll(data: bytes) -> set[str]:
    """What a PE file exports: the names of its export directory."""
    directory = in_dll(data, directory_of_dll(data, 0))
    count, names = unsigned(data, directory + 24), in_dll(data, unsigned(data, directory + 32))
    return {text(data, in_dll(data, unsigned(data, names + 4 * n))) for n in range(count)}


def libraries_of_dll(data: bytes) -> set[str]:
    """The libraries that a PE file needs: those of its import directory."""
    entry = in_dll(data, directory_of_dll(data, 1))
    found = set[str]()
    while name := unsigned(data, entry + 12):
        found.add(text(data, in_dll(data, name)))
        entry += 20
    return found


def directory_of_dll(data: bytes, number: int) -> int:
    """The address of one of the directories of a PE file."""
    return unsigned(data, unsigned(data, 0x3C) + 24 + 112 + 8 * number)


def in_dll(data: bytes, address: int) -> int:
    """Where in a PE file lies what is loaded to an address."""
    header = unsigned(data, 0x3C)
    sections, optional = unsigned(data, header + 6, "H"), unsigned(data, header + 20, "H")
    for number in range(sections):
        section = header + 24 + optional + 40 * number + 8
        size, begin, _, raw = struct.unpack_from("<4I", data, section)
        if begin <= address < begin + size:
            return raw + address - begin
    raise AssertionError(address)


def names_in_dylib(data: bytes) -> set[str]:
    """What a Mach-O file defines for others: external symbols of a section, less a `_`."""
    found = set[str]()
    for place in load_commands(data, 2):  # LC_SYMTAB
        symbols, count, strings, _ = struct.unpack_from("<4I", data, place + 8)
        for number in range(count):
            name, kind = struct.unpack_from("<IB", data, symbols + 16 * number)
            is_private = kind & 0x10
            if kind & 0x0E == 0x0E and kind & 1 and not is_private:
                found.add(text(data, strings + name).removeprefix("_"))
    return found


def libraries_of(data: bytes) -> list[str]:
    """What a Mach-O library is called, and those that it needs: LC_ID_DYLIB, LC_LOAD_DYLIB."""
    places = [*load_commands(data, 0xD), *load_commands(data, 0xC)]
    return [text(data, place + unsigned(data, place + 8)) for place in places]


def oldest_system(data: bytes) -> int:
    """The first macOS that a Mach-O file says it runs on: LC_BUILD_VERSION."""
    (place,) = load_commands(data, 0x32)
    return unsigned(data, place + 12) >> 16


def load_commands(data: bytes, wanted: int) -> list[int]:
    """Where commands of a kind begin in a Mach-O file."""
    place, found = 32, list[int]()
    for _ in range(unsigned(data, 16)):
        command, size = struct.unpack_from("<2I", data, place)
        if command == wanted:
            found.append(place)
        place += size
    return found


def unsigned(data: bytes, place: int, kind: str = "I") -> int:
    (value,) = struct.unpack_from(f"<{kind}", data, place)
    return int(value)


def text(data: bytes, place: int) -> str:
    return data[place : data.index(b"\0", place)].decode()

"""Adds the addresses of variables in an ELF file to the ASAP2 file of an export."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from backends.asap2.addresses import Symbol, epk, filled, linked
from backends.c.host.library import NUMBERS
from msnn.errors import targets as faults
from msnn.packages import ELFTOOLS
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings, SpecError

_ADDRESS, _INDEX = 0x03, 0xA1
"""DW_OP_addr and DW_OP_addrx: an address, and an index into the address table."""
_ALIASES = ("DW_TAG_typedef", "DW_TAG_const_type", "DW_TAG_volatile_type")
_STRUCTS = ("DW_TAG_structure_type", "DW_TAG_class_type")
_DEEPEST = 8


@dataclass(frozen=True, slots=True)
class DwarfMember:
    """A member of a C struct in debug information: its offset and size in bytes."""

    offset: int
    size: int


@dataclass(frozen=True, slots=True)
class Instance:
    """A variable in the program of a controller whose type is one of the requested ones.

    It may also be a member of another variable.
    """

    name: str
    """`controller`, or `vehicle.controller` for a member."""
    type: str
    address: int
    members: Mapping[str, DwarfMember] = field(compare=False, hash=False)


@dataclass(frozen=True, slots=True)
class Elf:
    """The variables of the requested types in an ELF file, with their addresses."""

    big_endian: bool
    instances: tuple[Instance, ...]
    texts: Mapping[str, tuple[int, str]] = field(default_factory=dict[str, tuple[int, str]])
    """Address and contents of the requested character arrays in the image, by name."""


def elf_variables(path: Path, types: Iterable[str], texts: Iterable[str] = ()) -> Elf:
    """All variables with a fixed address that are, or contain, one of these typedefs.

    `texts` are names of character arrays, which a linker may have removed. Nested structs count
    too, such as parameters next to their checksum. Raises MissingExtraError without pyelftools,
    SpecError for a file without DWARF, and OSError.
    """
    ELFTOOLS.require("reads the addresses")
    elf_file: Any = import_module("elftools.elf.elffile").ELFFile
    failures: Any = import_module("elftools.common.exceptions")
    with path.open("rb") as stream:
        try:
            elf = elf_file(stream)
            # addresses in an object are offsets that a linker has yet to move
            if elf["e_type"] == "ET_REL":
                raise _unreadable(path, "it is an object that was not linked yet")
            if not elf.has_dwarf_info(strict=True):
                raise _unreadable(path, "it has no debug information")
            # what several units describe counts once
            found = dict.fromkeys(_all_instances(elf.get_dwarf_info(), frozenset(types)))
            return Elf(not elf.little_endian, tuple(found), _texts(elf, frozenset(texts)))
        except failures.ELFError as error:
            raise _unreadable(path, f"it is no ELF file ({error})") from None
        except failures.DWARFError as error:
            raise _unreadable(path, f"its debug information cannot be read ({error})") from None


def _texts(elf: Any, names: frozenset[str]) -> dict[str, tuple[int, str]]:
    symbols = elf.get_section_by_name(".symtab")
    found: dict[str, tuple[int, str]] = {}
    for symbol in symbols.iter_symbols() if symbols is not None and names else ():
        if symbol.name in names and isinstance(symbol["st_shndx"], int):
            section = elf.get_section(symbol["st_shndx"])
            begin = symbol["st_value"] - section["sh_addr"]
            data: bytes = section.data()[begin : begin + symbol["st_size"]]
            found[symbol.name] = symbol["st_value"], data.rstrip(b"\0").decode("utf-8", "replace")
    return found


def _unreadable(path: Path, reason: str) -> SpecError:
    return SpecError([faults.no_debug_information(str(path), reason)])


def _all_instances(dwarf: Any, types: frozenset[str]) -> Iterator[Instance]:
    for unit in dwarf.iter_CUs():
        for die in unit.iter_DIEs():
            if die.tag == "DW_TAG_variable" and "DW_AT_location" in die.attributes:
                address = _address(dwarf, unit, die.attributes["DW_AT_location"])
                declared = _declaration(die)
                if address is not None and "DW_AT_type" in declared.attributes:
                    kind = declared.get_DIE_from_attribute("DW_AT_type")
                    yield from _instances(kind, _name(declared), address, types)


def _declaration(die: Any) -> Any:
    """The declaration of a variable whose definition is separate."""
    while "DW_AT_specification" in die.attributes:
        die = die.get_DIE_from_attribute("DW_AT_specification")
    return die


def _address(dwarf: Any, unit: Any, location: Any) -> int | None:
    """The fixed address; None for variables in a register, on a stack, or optimised away."""
    if location.form not in ("DW_FORM_exprloc", "DW_FORM_block1"):
        return None
    expression = bytes(location.value)
    size: int = unit["address_size"]
    if expression[:1] == bytes([_ADDRESS]) and len(expression) == 1 + size:
        order = "little" if dwarf.config.little_endian else "big"
        return int.from_bytes(expression[1:], order)
    if expression[:1] == bytes([_INDEX]):
        # ULEB128: seven bits a byte, the lowest first
        number = sum((byte & 0x7F) << 7 * place for place, byte in enumerate(expression[1:]))
        return int(dwarf.get_addr(unit, number))
    return None


def _instances(
    kind: Any, name: str, address: int, types: frozenset[str], depth: int = 0
) -> Iterator[Instance]:
    # a typedef may stand for another one: each on the way can be a wanted one
    while kind.tag in _ALIASES and "DW_AT_type" in kind.attributes:
        if kind.tag == "DW_TAG_typedef" and _name(kind) in types:
            yield Instance(name, _name(kind), address, dict(_members(_plain(kind))))
        kind = kind.get_DIE_from_attribute("DW_AT_type")
    if kind.tag in _STRUCTS and depth < _DEEPEST:
        for die in kind.iter_children():
            if die.tag == "DW_TAG_member" and "DW_AT_name" in die.attributes:
                inner = die.get_DIE_from_attribute("DW_AT_type")
                place = address + _offset(die)
                yield from _instances(inner, f"{name}.{_name(die)}", place, types, depth + 1)


def _members(struct: Any) -> Iterator[tuple[str, DwarfMember]]:
    for die in struct.iter_children():
        if die.tag == "DW_TAG_member" and "DW_AT_name" in die.attributes:
            kind = die.get_DIE_from_attribute("DW_AT_type")
            yield _name(die), DwarfMember(_offset(die), _size(kind))


def _plain(kind: Any) -> Any:
    while kind.tag in _ALIASES and "DW_AT_type" in kind.attributes:
        kind = kind.get_DIE_from_attribute("DW_AT_type")
    return kind


def _size(kind: Any) -> int:
    kind = _plain(kind)
    if kind.tag != "DW_TAG_array_type":
        return int(_value(kind, "DW_AT_byte_size"))
    size = _size(kind.get_DIE_from_attribute("DW_AT_type"))
    for die in kind.iter_children():
        if die.tag == "DW_TAG_subrange_type":
            has_count = "DW_AT_count" in die.attributes
            # the upper bound is the last index; a flexible array has none, and size 0
            bound = _value(die, "DW_AT_upper_bound", -1) + 1
            size *= _value(die, "DW_AT_count") if has_count else bound
    return size


def _offset(die: Any) -> int:
    return _value(die, "DW_AT_data_member_location")


def _value(die: Any, attribute: str, missing: int = 0) -> int:
    """A constant attribute; 0 for run-time expressions, which generated C does not have."""
    value = die.attributes[attribute].value if attribute in die.attributes else missing
    return value if isinstance(value, int) else missing


def _name(die: Any) -> str:
    named = die.attributes.get("DW_AT_name")
    return "" if named is None else named.value.decode("utf-8", "replace")


OPTIONS = {
    "params": "--params",
    "state": "--state",
    "in": "--inputs",
    "out": "--outputs",
    "calibration": "--calibration",
}
"""Structs, and the options that name their variables."""


@dataclass(frozen=True, slots=True)
class Filled:
    """An ASAP2 file (A2L) with addresses, and the variable that was used for each struct."""

    text: str
    instances: Mapping[str, Instance]
    """Variable by struct."""
    objects: int
    """Number of objects with an address."""
    warnings: tuple[Diagnostic, ...]


def fill_addresses(elf: Path, export: Path, chosen: Mapping[str, str]) -> Filled:
    """Writes the addresses of variables from an ELF file into the text of the export's ASAP2 file.

    `chosen` names the variable of a struct if there are several. Otherwise parameters are the only
    variable of their type besides the defaults. Raises SpecError, MissingExtraError, OSError.
    """
    text, description = _export(export)
    prefix: str = description["prefix"]
    links = linked(text)
    # a struct that nothing is linked to needs no variable
    counts = {s: sum(link.startswith(f"{prefix}_{s}_t.") for link in links) for s in OPTIONS}
    types = {struct: f"{prefix}_{struct}_t" for struct in OPTIONS if counts[struct]}
    identity = f"{prefix}_export_sha256"
    found = elf_variables(elf, types.values(), [identity])
    if not found.instances:
        raise SpecError([faults.no_instances(str(elf), list(types.values()))])
    findings = Findings()
    instances: dict[str, Instance] = {}
    warnings: list[Diagnostic] = []
    for struct, type in types.items():
        there = [instance for instance in found.instances if instance.type == type]
        instance = _choose(there, struct, type, chosen.get(struct), findings)
        if instance is not None:
            _compare(instance, _sizes(description, struct), findings)
            instances[struct] = instance
        elif not there:
            warnings.append(faults.without_address(type, counts[struct]))
    wanted, (at, there) = epk(text), found.texts.get(identity, (0, ""))
    if there and wanted is not None and there != wanted:
        findings.report(faults.other_image(str(elf), there, wanted))
    # after all structs: one look at the options mends them together
    findings.raise_errors()
    symbols = _symbols(instances)
    if there:
        symbols[f"EPK {there}"] = Symbol(identity, at)
    return Filled(
        filled(text, symbols.get, big_endian=found.big_endian),
        instances,
        sum(link in symbols for link in links),
        tuple(warnings),
    )


def _export(folder: Path) -> tuple[str, dict[str, Any]]:
    files = sorted(folder.glob("*.a2l"))
    descriptions = [file.with_suffix(".json") for file in files]
    # of two files nobody could say which one is of this ELF
    if len(files) == 1 and descriptions[0].is_file():
        try:
            description = json.loads(descriptions[0].read_text(encoding="utf-8"))["c"]
            if description["dtype"] in NUMBERS and {"prefix", "structs"} <= set(description):
                return files[0].read_text(encoding="utf-8"), description
        except (ValueError, KeyError, TypeError):
            pass
    raise SpecError([faults.no_calibrated_export(str(folder))])


def _choose(
    there: Sequence[Instance], struct: str, type: str, name: str | None, findings: Findings
) -> Instance | None:
    if name is not None:
        named = [instance for instance in there if instance.name == name]
        if len(named) == 1:
            return named[0]
        names = [instance.name for instance in there]
        if named:
            findings.report(faults.several_instances(type, names, OPTIONS[struct]))
        else:
            findings.report(faults.no_such_instance(name, type, names))
        return None
    # the defaults are constants in flash: who has a copy of them calibrates the copy
    default = f"{type.removesuffix('_t')}_default"
    own = [instance for instance in there if instance.name != default] or there
    if len(own) > 1:
        names = [instance.name for instance in there]
        findings.report(faults.several_instances(type, names, OPTIONS[struct]))
    return own[0] if len(own) == 1 else None


def _sizes(description: Mapping[str, Any], struct: str) -> dict[str, int]:
    """The size in bytes of each member of a struct."""
    types = NUMBERS[description["dtype"]]
    return {
        member["field"]: np.dtype(types[member["type"]]).itemsize * math.prod(member["shape"])
        for member in description["structs"].get(struct, ())
        if member["type"] in types
    }


def _compare(instance: Instance, sizes: Mapping[str, int], findings: Findings) -> None:
    for member, size in sizes.items():
        place = instance.members.get(member)
        if place is None:
            reason = "is not in it"
        elif place.size != size:
            reason = f"has {place.size} bytes there and {size} in the export"
        else:
            continue
        findings.report(faults.other_layout(f"{instance.name}.{member}", reason))


def _symbols(instances: Mapping[str, Instance]) -> dict[str, Symbol]:
    """Symbols by the link of an export: type and member; for a segment the type only."""
    whole = {each.type: Symbol(each.name, each.address) for each in instances.values()}
    return whole | {
        f"{instance.type}.{member}": Symbol(
            f"{instance.name}.{member}", instance.address + at.offset
        )
        for instance in instances.values()
        for member, at in instance.members.items()
    }

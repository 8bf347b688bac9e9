"""Reads variables, their addresses and their members from the DWARF of an ELF file."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

from msnn.errors.targets import calibration as faults
from msnn.packages import ELFTOOLS
from spec_schema.diagnostics.diagnostic import SpecError

_ADDRESS, _INDEX = 0x03, 0xA1
"""DW_OP_addr and DW_OP_addrx: an address, and an index into the address table."""
_ALIASES = ("DW_TAG_typedef", "DW_TAG_const_type", "DW_TAG_volatile_type")
_STRUCTS = ("DW_TAG_structure_type", "DW_TAG_class_type")
_DEEPEST = 8


@dataclass(frozen=True, slots=True)
class DwarfMember:
    """The offset of a member in its struct, and its size in bytes."""

    offset: int
    size: int


@dataclass(frozen=True, slots=True)
class Instance:
    """A variable of one of the requested types, or such a member of another variable."""

    name: str
    """`controller`, or `vehicle.controller` for a member."""
    type: str
    address: int
    members: Mapping[str, DwarfMember] = field(compare=False, hash=False)


@dataclass(frozen=True, slots=True)
class Elf:
    """The variables of the requested types in a file."""

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

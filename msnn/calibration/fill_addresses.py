"""Adds the addresses of variables in an ELF file to the ASAP2 file of an export."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from backends.asap2.addresses import Symbol, epk, filled, linked
from backends.c.host.library import NUMBERS
from msnn.calibration.elf_variables import Instance, elf_variables
from msnn.errors.targets import calibration as faults
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings, SpecError

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
    """The completed file, and the variable of each struct."""

    text: str
    instances: Mapping[str, Instance]
    """Variable by struct."""
    objects: int
    """Number of objects with an address."""
    warnings: tuple[Diagnostic, ...]


def fill_addresses(elf: Path, export: Path, chosen: Mapping[str, str]) -> Filled:
    """The ASAP2 file of the export with addresses of the variables in the ELF file.

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
    """Bytes of each member."""
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

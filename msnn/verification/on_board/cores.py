"""Identifies a Cortex-M by its registers, and selects the compiler options."""

from __future__ import annotations

from dataclasses import dataclass

CPUID, FPU_FEATURES = 0xE000ED00, 0xE000EF40
"""Register addresses: core identity (CPUID), floating-point features (MVFR0)."""


@dataclass(frozen=True, slots=True)
class Core:
    """A core and the options of gcc for it."""

    name: str
    flags: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Family:
    name: str
    cpu: str
    single: str | None = None
    """The single-precision FPU option."""
    double: str | None = None
    """The double-precision FPU option."""


_FAMILIES = {
    0xC20: _Family("Cortex-M0", "cortex-m0"),
    0xC60: _Family("Cortex-M0+", "cortex-m0plus"),
    0xC23: _Family("Cortex-M3", "cortex-m3"),
    0xC24: _Family("Cortex-M4", "cortex-m4", "fpv4-sp-d16"),
    0xC27: _Family("Cortex-M7", "cortex-m7", "fpv5-sp-d16", "fpv5-d16"),
    0xD20: _Family("Cortex-M23", "cortex-m23"),
    0xD21: _Family("Cortex-M33", "cortex-m33", "fpv5-sp-d16"),
}
"""Cores by the part number in CPUID, from their technical reference manuals."""


def core_of(identity: int, fpu: int) -> Core | None:
    """The core with this CPUID and MVFR0 (`fpu`); None if it is unknown."""
    # PARTNO of CPUID; variant and revision around it do not matter to a compiler
    family = _FAMILIES.get((identity >> 4) & 0xFFF)
    if family is None:
        return None
    # MVFR0: fields of single and of double precision, 0 for none
    single, double = bool((fpu >> 4) & 0xF), bool((fpu >> 8) & 0xF)
    unit = (family.double if double else None) or (family.single if single else None)
    own = ("-mfloat-abi=soft",) if unit is None else ("-mfloat-abi=hard", f"-mfpu={unit}")
    return Core(
        family.name if unit is None else f"{family.name} with FPU",
        (f"-mcpu={family.cpu}", "-mthumb", *own),
    )

"""Reads the folder of a C export: its contents, and the ranges declared in its spec."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from msnn.errors.commands import not_exported_c
from msnn.verification.sources import CFolder, plain_hash, plain_name
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.reading.reader import refuse_endless
from spec_schema.registry import ARITHMETICS

Range = tuple[float, float]

_GOLDEN_STATUS = re.compile(r"golden_status\[(\d+)\]")
"""Matches the table of expected results of golden steps."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RangedField:
    """A field of a generated struct, with the range of its values if the spec has one."""

    field: str
    size: int | None
    """None for a scalar."""
    unsigned: bool
    name: str
    range: Range | None
    policy: str = ""
    """Policy of the step for invalid values of an input; empty for other fields."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportedC(CFolder):
    """A model as described by the files of its export."""

    prefix: str
    identity: str
    """The hash of the export, from its description."""
    dtype: str
    takes_parameters: bool
    calibration: str | None
    """The variable with parameters for calibration tools; None without calibration."""
    exact: bool
    """True if every build must give identical bits; else results agree within a tolerance."""
    inputs: tuple[RangedField, ...]
    start: tuple[RangedField, ...]
    """Arguments of `reset`."""
    state: tuple[RangedField, ...]
    outputs: tuple[RangedField, ...]
    slopes: tuple[RangedField, ...]
    """Matrices of the Jacobian; empty without one."""
    expected: tuple[str, ...]
    """Expected result of each golden step: status and output bits, in hexadecimal digits.

    The file of vectors contains the actions before each step.
    """
    status: dict[str, int]
    """The C names of the status bits."""

    @property
    def identities(self) -> dict[str, str]:
        """The hash of all files, as for exports with several parts."""
        return {"*": self.identity}

    @property
    def fixed_point(self) -> bool:
        """True if it uses integer arithmetic."""
        return self.dtype in ARITHMETICS

    @property
    def constant_time(self) -> bool:
        """True if it is constant-time: the instructions do not depend on the values."""
        hides = f"{self.prefix}_truth(bool condition)"
        # the helper is in the text of such exports alone
        return any(hides in path.read_text(encoding="utf-8") for path in self.model_sources)

    @property
    def compares_states(self) -> bool:
        """True if its golden vectors contain the state after single steps."""
        # exports of earlier versions have none; their vectors compare answers alone
        return f"{self.prefix}_state_differs(" in self._vectors

    @property
    def golden_steps(self) -> int:
        """The number of steps of its golden vectors."""
        begin = self._vectors.find(f"{self.prefix}_results_differ(")
        found = _GOLDEN_STATUS.search(self._vectors, max(begin, 0))
        return 0 if begin < 0 or found is None else int(found[1])

    @property
    def _vectors(self) -> str:
        path = self.folder / "test" / f"{self.prefix}_vectors.h"
        return path.read_text(encoding="utf-8")

    @property
    def number(self) -> str:
        """The C type of the outputs."""
        return f"{self.prefix}_{'word_t' if self.fixed_point else 'real'}"

    @property
    def reals(self) -> int:
        """Number of real values in the struct of outputs."""
        return _reals(self.outputs)

    @property
    def linearizes(self) -> bool:
        """True if it has a Jacobian."""
        return bool(self.slopes)

    @property
    def hashed_reals(self) -> int:
        """Number of values of the Jacobian that are hashed in each golden step; 0 for none."""
        return _reals(self.slopes) if self.exact else 0


def _reals(members: tuple[RangedField, ...]) -> int:
    return sum(m.size or 1 for m in members if not m.unsigned)


UNREADABLE = (
    OSError,
    ValueError,
    KeyError,
    TypeError,
    AttributeError,
    OverflowError,
    RecursionError,
)
"""Exceptions of reading an untrusted description."""


def described(path: Path) -> Any:
    """The JSON description in a file, not validated; raises one of UNREADABLE."""
    refuse_endless(path)
    return json.loads(path.read_text(encoding="utf-8"))


def read_exported_c(folder: Path) -> ExportedC:
    """The export in a folder; SpecError (E1046) if there is none of a supported version."""
    damaged: str | None = None
    for path in sorted(folder.glob("*.json")):
        try:
            return _read(folder, described(path))
        # files of other tools may lie beside ours; whatever shape they have, the next one is tried
        except UNREADABLE:
            if (folder / "include" / f"{path.stem}.h").is_file():
                damaged = damaged or path.name
    raise SpecError([not_exported_c(str(folder), "c", damaged)])


def _read(folder: Path, about: dict[str, Any]) -> ExportedC:
    layout = about["c"]
    prefix = plain_name(layout["prefix"])
    expected = (folder / "test" / f"{prefix}_expected.txt").read_text(encoding="utf-8")
    structs = layout["structs"]
    return ExportedC(
        folder=folder.resolve(),
        prefix=prefix,
        identity=plain_hash(about["export_sha256"]),
        dtype=layout["dtype"],
        takes_parameters=bool(layout["takes_parameters"]),
        calibration=layout.get("calibration", {}).get("variable"),
        exact=bool(layout["exact"]),
        inputs=_members(structs["in"], layout.get("on_invalid", {})),
        start=_members(structs["init"]),
        state=_members(structs["state"]),
        outputs=_members(structs["out"]),
        slopes=_members(structs.get("jacobian", [])),
        expected=tuple(line for line in expected.splitlines() if line),
        status=layout["status"],
    )


def _members(
    fields: list[dict[str, Any]], policies: Mapping[str, str] = MappingProxyType({})
) -> tuple[RangedField, ...]:
    return tuple(
        RangedField(
            field=plain_name(field["field"]),
            size=math.prod(field["shape"]) if field["shape"] else None,
            unsigned=field["type"] == "uint32",
            name=field["name"] or field["field"],
            # with one end alone it is none: what is proved and fuzzed needs both
            range=_range(field["range"]),
            policy=policies.get(field["field"], ""),
        )
        for field in fields
    )


def _range(bounds: list[float | None] | None) -> Range | None:
    if bounds is None or bounds[0] is None or bounds[1] is None:
        return None
    return float(bounds[0]), float(bounds[1])

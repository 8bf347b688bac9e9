"""Reads the folder of a C export: contents, declared ranges, differences from its manifest."""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path, PurePosixPath, PureWindowsPath
from types import MappingProxyType
from typing import Any, Protocol

from backends.files.export_identity import MANIFEST, OPEN, identity_of, read_manifest
from msnn.errors.commands import not_exported_c
from msnn.verification.proof_step import ProofStep, Result
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.reading.reader import refuse_endless
from spec_schema.registry import ARITHMETICS

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_HASH = re.compile(r"[0-9a-f]{64}")


class Sources(Protocol):
    """A folder with generated C: `include`, `src` and, in some exports, `test`."""

    @property
    def folder(self) -> Path: ...

    @property
    def prefix(self) -> str:
        """The prefix of its C names."""
        ...

    @property
    def calibration(self) -> str | None:
        """The name of the C variable whose parameters calibration tools change; None without
        calibration.
        """
        ...

    @property
    def include(self) -> Path: ...

    @property
    def sources(self) -> tuple[Path, ...]: ...

    @property
    def model_sources(self) -> tuple[Path, ...]:
        """The deployed sources, without self-tests."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class CFolder:
    """A folder of exported C, with the paths of its files."""

    folder: Path

    @property
    def include(self) -> Path:
        return self.folder / "include"

    @property
    def sources(self) -> tuple[Path, ...]:
        return tuple(sorted((self.folder / "src").glob("*.c")))

    @property
    def model_sources(self) -> tuple[Path, ...]:
        """The deployed sources, without self-tests."""
        return tuple(path for path in self.sources if not path.stem.endswith("_selftest"))


def plain_name(text: str) -> str:
    """The text if it is a plain C name; it is used in C code and command lines. ValueError."""
    if not _NAME.fullmatch(text):
        raise ValueError(text)
    return text


def plain_hash(text: str) -> str:
    """The text if it is a SHA-256 in hexadecimal digits; ValueError or TypeError for another."""
    if not _HASH.fullmatch(text):
        raise ValueError(text)
    return text


def includes(model: Sources) -> list[str]:
    """Include options for the export and its vectors."""
    return [f"-I{model.include}", f"-I{model.folder / 'src'}", f"-I{model.folder / 'test'}"]


Range = tuple[float, float]

_GOLDEN_STATUS = re.compile(r"golden_status\[(\d+)\]")
"""Matches the table of expected results of golden steps."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RangedField:
    """A member of a generated C struct, with the range of its values if the spec gives one."""

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
    """A C export that is to be verified, as the JSON description in its folder says."""

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
        """The hash of the export, for all files (`*`); exports with several parts have several."""
        return {"*": self.identity}

    @property
    def fixed_point(self) -> bool:
        """True if the exported code uses integer arithmetic."""
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
        """The C type of an output's element."""
        return f"{self.prefix}_{'word_t' if self.fixed_point else 'real'}"

    @property
    def reals(self) -> int:
        """Number of real values in the struct of outputs."""
        return _reals(self.outputs)

    @property
    def linearizes(self) -> bool:
        """True if the export has a function for the Jacobian."""
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
    """The content of a JSON file, not checked; raises one of the errors in UNREADABLE."""
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


_BUILT = ("include", "src", "test")
"""Folders from which builds use every file."""


def files_check(model: Sources, identities: Mapping[str, str]) -> ProofStep:
    """A check that no file of the export was changed, removed or added since it was written.

    `identities` maps patterns of file names to the hashes in the descriptions of the export's
    parts.
    """

    def run(folder: Path) -> Result:
        try:
            listed = read_manifest(model.folder)
        except (OSError, ValueError):
            return check.of([f"{MANIFEST} is missing or damaged: export again"], "no manifest")
        if outside := [path for path in listed if _leads_out(model.folder, path)]:
            found = [f"{MANIFEST} names {path}, which is outside of the export" for path in outside]
            return check.of(found, "no files of the export")
        found = _differences(model.folder, listed)
        if not found:
            parts = identities.items()
            found = [line for names, told in parts for line in _another(model, listed, names, told)]
        names = ", ".join(identity[:12] for identity in identities.values())
        return check.of(found, f"{len(listed)} files of the export {names}")

    check = ProofStep("files", "all", (), run)
    return check


def _leads_out(folder: Path, path: str) -> bool:
    """True if a path of the manifest leaves the folder, also by a link or with Windows syntax."""
    parts = {*PurePosixPath(path).parts, *PureWindowsPath(path).parts}
    is_absolute = PurePosixPath(path).is_absolute() or PureWindowsPath(path).anchor != ""
    if is_absolute or ".." in parts:
        return True
    return not (folder / path).resolve().is_relative_to(folder.resolve())


def _differences(folder: Path, listed: dict[str, str]) -> list[str]:
    found: list[str] = []
    converted: list[str] = []
    for path, digest in listed.items():
        content = _content(folder / path)
        if content is None:
            found.append(f"{path} is missing")
        elif digest == _hash(content):
            continue
        elif digest == _hash(content.replace(b"\r\n", b"\n")):
            converted.append(path)
        else:
            found.append(f"{path} was changed after it was exported")
    if converted:
        found.append(
            f"{', '.join(converted)}: CRLF at the ends of lines where the export has LF; "
            "`* -text` in .gitattributes keeps git from changing them"
        )
    inside = [name for name in _BUILT if not _leads_out(folder, name)]
    found += [f"{name} leads out of the export" for name in _BUILT if name not in inside]
    there = [path for name in inside for path in sorted((folder / name).rglob("*"))]
    extra = [path.relative_to(folder).as_posix() for path in there if path.is_file()]
    # builds take whatever lies there
    return [*found, *(f"{path} is no file of the export" for path in extra if path not in listed)]


def _another(model: Sources, listed: dict[str, str], names: str, identity: str) -> list[str]:
    """A finding if files match the manifest but not the hash: both were edited."""
    own = [path for path in listed if fnmatchcase(PurePosixPath(path).name, names)]
    contents = {path: _content(model.folder / path) or b"" for path in own}
    texts = {path: content.decode("utf-8", "replace") for path, content in contents.items()}
    computed = identity_of({path: text.replace(identity, OPEN) for path, text in texts.items()})
    files = f"the files that {MANIFEST} lists" if names == "*" else f"the files {names}"
    said = f"{files} have the identity {computed[:12]}, their description {identity[:12]}"
    why = f"a file was changed, added or left out, and {MANIFEST} with it"
    return [] if computed == identity else [f"{said}: {why}"]


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _content(path: Path) -> bytes | None:
    try:
        refuse_endless(path)
        return path.read_bytes()
    except (OSError, ValueError):
        return None

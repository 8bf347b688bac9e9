"""Compares the files of an export with its manifest, and with the hash written into them."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from fnmatch import fnmatchcase
from pathlib import Path, PurePosixPath, PureWindowsPath

from backends.files.export_identity import MANIFEST, OPEN, identity_of, read_manifest
from msnn.verification.proof_step import ProofStep, Result
from msnn.verification.sources import Sources
from spec_schema.reading.reader import refuse_endless

_BUILT = ("include", "src", "test")
"""Folders from which builds use every file."""


def files_check(model: Sources, identities: Mapping[str, str]) -> ProofStep:
    """Checks that no file of the export was changed, removed or added.

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

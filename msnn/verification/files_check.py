"""Compares the files of an export with its manifest, and with the identity that stands in them."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

from backends.files.export_identity import MANIFEST, OPEN, identity_of, read_manifest
from msnn.verification.proof_step import ProofStep, Result
from msnn.verification.sources import Sources

_BUILT = ("include", "src", "test")
"""Folders of which builds take every file."""


def files_check(model: Sources, identities: Sequence[str]) -> ProofStep:
    """No file of the export was changed, left out or added since it was written.

    `identities` are the hashes of its parts, as their descriptions have them.
    """

    def run(folder: Path) -> Result:
        try:
            listed = read_manifest(model.folder)
        except (OSError, ValueError):
            return check.of([f"{MANIFEST} is missing or damaged: export again"], "no manifest")
        found = _differences(model.folder, listed) or _of_another_export(
            model, identities[0], listed
        )
        names = ", ".join(identity[:12] for identity in identities)
        return check.of(found, f"{len(listed)} files of the export {names}")

    check = ProofStep("files", model.prefix, (), run)
    return check


def _differences(folder: Path, listed: dict[str, str]) -> list[str]:
    found: list[str] = []
    for path, digest in listed.items():
        content = _content(folder / path)
        if content is None:
            found.append(f"{path} is missing")
        # version control may have changed the ends of lines
        elif digest not in (_hash(content), _hash(content.replace(b"\r\n", b"\n"))):
            found.append(f"{path} was changed after it was exported")
    there = [path for name in _BUILT for path in sorted((folder / name).rglob("*"))]
    extra = [path.relative_to(folder).as_posix() for path in there if path.is_file()]
    # builds take whatever lies there
    return [*found, *(f"{path} is no file of the export" for path in extra if path not in listed)]


def _of_another_export(model: Sources, identity: str, listed: dict[str, str]) -> list[str]:
    """The files agree with the manifest: they may be those of an edited manifest."""
    if f"{model.prefix}.a2l" not in listed:
        return []  # a controller: each part has an identity, of its own files
    contents = {path: _content(model.folder / path) or b"" for path in listed}
    texts = {
        path: content.decode("utf-8", "replace").replace("\r\n", "\n")
        for path, content in contents.items()
    }
    computed = identity_of({path: text.replace(identity, OPEN) for path, text in texts.items()})
    said = f"the files have the identity {computed[:12]}, {model.prefix}.json has {identity[:12]}"
    return [] if computed == identity else [said]


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _content(path: Path) -> bytes | None:
    try:
        return path.read_bytes()
    except OSError:
        return None

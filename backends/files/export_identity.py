"""Gives an export an identity, a hash of all its files that stands in some of them; and a manifest.

Equal identities mean the same program, weights, options and version of msnn.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from pathlib import Path, PurePosixPath

OPEN = "msnn-id-" * 8
"""Stands in texts where the identity will, of the same length: the hash is of texts with this."""

MANIFEST = "manifest.sha256"
"""Lists every file of an export, as `sha256sum --check` reads it."""


_LINE = re.compile(
    # as GNU writes it, the file read as text or binary; as BSD does
    r"\s*(?P<escaped>\\?)"
    r"(?:(?P<digest>[0-9a-fA-F]{64}) [ *]?(?P<path>.+)"
    r"|SHA256 ?\((?P<bsd_path>.+)\) ?= ?(?P<bsd_digest>[0-9a-fA-F]{64}))",
    re.DOTALL,
)
_ESCAPES = {"\\\\": "\\", "\\n": "\n", "\\r": "\r"}
"""Of names in a line that begins with a backslash."""


def with_identity(texts: Mapping[str, str]) -> dict[str, str]:
    """The texts, by path, with their identity in the place of `OPEN`."""
    identity = identity_of(texts)
    return {path: text.replace(OPEN, identity) for path, text in texts.items()}


def with_manifest(texts: Mapping[str, str]) -> dict[str, str]:
    """The texts, and the manifest of their files."""
    contents = {path: text.encode() for path, text in texts.items()}
    return {**texts, MANIFEST: manifest_text(contents)}


def identity_of(texts: Mapping[str, str]) -> str:
    """The SHA-256 of paths and texts, in which `OPEN` is where the identity belongs.

    Self-tests have no part in it: bits that a compiler records are in some of them.
    """
    digest = hashlib.sha256()
    for path, text in sorted(texts.items()):
        if "_selftest" in path:
            continue
        data = text.encode()
        # lengths too, so that no two lists of files give the same bytes
        digest.update(f"{path}\n{len(data)}\n".encode())
        digest.update(data)
    return digest.hexdigest()


def manifest_text(contents: Mapping[str, bytes]) -> str:
    """One line per file: the SHA-256 of its bytes, two blanks, its path."""
    hashes = {path: hashlib.sha256(data).hexdigest() for path, data in contents.items()}
    return "".join(f"{digest}  {path}\n" for path, digest in sorted(hashes.items()))


def read_manifest(folder: Path) -> dict[str, str]:
    """The SHA-256 of each file by its path. Raises OSError, ValueError for another text.

    Lines as `sha256sum --check` reads them; one that it would skip is another text. The file that a
    line names may be anywhere: the text may be anybody's.
    """
    listed: dict[str, str] = {}
    for line in (folder / MANIFEST).read_text(encoding="utf-8").splitlines():
        if not line or line.startswith("#"):
            continue
        path, digest = _entry(line)
        if listed.setdefault(path, digest) != digest:
            raise ValueError(MANIFEST)  # of one path with two hashes, one would not be looked at
    return listed


def _entry(line: str) -> tuple[str, str]:
    """The path, without `./`, and the hash of a line of a manifest; ValueError."""
    found = _LINE.fullmatch(line)
    if found is None:
        raise ValueError(MANIFEST)
    path = found["path"] or found["bsd_path"]
    digest = found["digest"] or found["bsd_digest"]
    if found["escaped"]:
        path = re.sub(r"\\[\\nr]", lambda each: _ESCAPES[each[0]], path)
    return str(PurePosixPath(path)), digest.lower()

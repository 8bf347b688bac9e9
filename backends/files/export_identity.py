"""Gives an export an identity, a hash of its files that some of them contain, and a manifest.

Equal identities mean the same program, weights, options and version of msnn.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from pathlib import Path, PurePosixPath

OPEN = "msnn-id-" * 8
"""Placeholder of the identity, of the same length; the hash is taken of texts with the
placeholder."""

MANIFEST = "manifest.sha256"
"""Lists every file of an export, in the format of `sha256sum --check`."""


_LINE = re.compile(
    # the GNU format for text or binary, and the BSD format
    r"\s*(?P<escaped>\\?)"
    r"(?:(?P<digest>[0-9a-fA-F]{64}) [ *]?(?P<path>.+)"
    r"|SHA256 ?\((?P<bsd_path>.+)\) ?= ?(?P<bsd_digest>[0-9a-fA-F]{64}))",
    re.DOTALL,
)
_ESCAPES = {"\\\\": "\\", "\\n": "\n", "\\r": "\r"}
"""Escapes of names in a line that starts with a backslash."""


def with_identity(texts: Mapping[str, str]) -> dict[str, str]:
    """The texts, by path, with the placeholder `OPEN` replaced by their identity."""
    identity = identity_of(texts)
    return {path: text.replace(OPEN, identity) for path, text in texts.items()}


def with_manifest(texts: Mapping[str, str]) -> dict[str, str]:
    """The texts, by path, and a manifest that lists their SHA-256."""
    contents = {path: text.encode() for path, text in texts.items()}
    return {**texts, MANIFEST: manifest_text(contents)}


def identity_of(texts: Mapping[str, str]) -> str:
    """The identity of an export: the SHA-256, in hexadecimal, of all paths and texts, which have
    the placeholder `OPEN` where the identity will be. Self-tests are excluded, as some contain bits
    that a compiler recorded.
    """
    digest = hashlib.sha256()
    for path, text in sorted(texts.items()):
        if "_selftest" in path:
            continue
        data = text.encode()
        # includes lengths, so that different lists of files give different bytes
        digest.update(f"{path}\n{len(data)}\n".encode())
        digest.update(data)
    return digest.hexdigest()


def manifest_text(contents: Mapping[str, bytes]) -> str:
    """The text of a manifest of files (path → bytes): a line for each with SHA-256, two blanks and
    path.
    """
    hashes = {path: hashlib.sha256(data).hexdigest() for path, data in contents.items()}
    return "".join(f"{digest}  {path}\n" for path, digest in sorted(hashes.items()))


def read_manifest(folder: Path) -> dict[str, str]:
    """The SHA-256 of each file that the manifest in a folder lists, by path. Raises OSError, and
    ValueError for another format, such as lines that `sha256sum --check` would skip. Paths may be
    outside the folder, as the text is untrusted.
    """
    listed: dict[str, str] = {}
    for line in (folder / MANIFEST).read_text(encoding="utf-8").splitlines():
        if not line or line.startswith("#"):
            continue
        path, digest = _entry(line)
        if listed.setdefault(path, digest) != digest:
            raise ValueError(MANIFEST)  # one of two hashes of a path would be ignored
    return listed


def _entry(line: str) -> tuple[str, str]:
    """The path, without `./`, and the SHA-256 in a line of a manifest. Raises ValueError for
    another format.
    """
    found = _LINE.fullmatch(line)
    if found is None:
        raise ValueError(MANIFEST)
    path = found["path"] or found["bsd_path"]
    digest = found["digest"] or found["bsd_digest"]
    if found["escaped"]:
        path = re.sub(r"\\[\\nr]", lambda each: _ESCAPES[each[0]], path)
    return str(PurePosixPath(path)), digest.lower()

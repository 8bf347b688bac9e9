"""Builds QEMU's instruction counter once per machine, and caches it with the kernels."""

from __future__ import annotations

import hashlib
import os
import platform
from contextlib import suppress
from pathlib import Path

from backends.native.kernel_cache import StoredKernel, candidates, opened
from msnn.verification.builds.harness import TEMPLATES
from msnn.verification.proof_step import run_tool
from msnn.verification.tools import GCC

_SOURCE = TEMPLATES / "instructions_plugin.c"
_FLAGS = ("-O1", "-fPIC", "-shared")


def instructions_plugin(folder: Path) -> Path:
    """The library of the plugin: from the cache, or built in `folder` without a usable cache.

    A comparison of models measures the C code of each; the cache avoids compiling the plugin each
    time.
    """
    # caches lie on shared disks, where another machine may run
    described = "\n".join((_SOURCE.read_text(encoding="utf-8"), *_FLAGS, platform.machine()))
    key = hashlib.sha256(described.encode()).hexdigest()[:32]
    for place in candidates():
        with suppress(OSError):  # full or closed
            real, reason = opened(place)
            # QEMU maps the library executable, which a file system mounted noexec refuses
            if reason is None and not os.statvfs(real).f_flag & os.ST_NOEXEC:
                stored = StoredKernel(real, key)
                if stored.whole() is None:
                    stored.built(_build)
                return stored.library
    library = folder / "instructions_plugin.so"
    _build(library, folder)
    return library


def _build(library: Path, folder: Path) -> None:
    run_tool([GCC.command, *_FLAGS, _SOURCE, "-o", library], folder)

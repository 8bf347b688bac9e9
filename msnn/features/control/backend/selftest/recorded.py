"""Compiles generated C where it is written, so that its self-test knows the bits it gives.

Every compiler gives the same ones (decision 0236), so that files do not depend on which it was.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping

from backends.files.c_compiler import CompilerMissingError
from backends.native.compile_kernel import KernelBuildError, compiled_kernel
from backends.native.exported.one_text import one_text


def compiled_texts(texts: Mapping[str, str]) -> ctypes.CDLL | None:
    """The library of these files; None where nothing compiles them."""
    try:
        return compiled_kernel(one_text(texts), briefly=True).library
    except (CompilerMissingError, KernelBuildError):
        return None

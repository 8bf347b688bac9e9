"""Compiles generated C at export, to record its results in its self-test.

The results are bit-identical for every compiler (decision 0268), and so are the written files.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping

from backends.files.c_compiler import CompilerMissingError
from backends.native.compile_kernel import KernelBuildError, compiled_kernel
from backends.native.exported.one_text import one_text


def compiled_texts(texts: Mapping[str, str]) -> ctypes.CDLL | None:
    """Compiles the files and loads the library; returns None without a working C compiler."""
    try:
        return compiled_kernel(one_text(texts), briefly=True).library
    except (CompilerMissingError, KernelBuildError):
        return None

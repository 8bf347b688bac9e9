"""Compiles exported C with a local compiler, to run it."""

from __future__ import annotations

import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from backends.c.host.build import CompilerFailedError, build_library
from backends.c.host.library import CStep
from backends.files.atomic_write import naming
from backends.files.c_compiler import CompilerMissingError
from msnn.errors.failures import MissingExtraError, UnfitCompilerError
from msnn.exports.target import Written


@contextmanager
def built_c(written: Written) -> Generator[CStep]:
    """One instance of the model in the written files, compiled and loaded.

    Raises MissingExtraError without a suitable C compiler.
    """
    with built_folder(written, "model.so") as folder:
        yield CStep.of_folder(folder, folder / "model.so")


@contextmanager
def built_folder(written: Written, library: str) -> Generator[Path]:
    """A temporary folder with only the written files and the built `library`.

    Raises MissingExtraError without a suitable C compiler.
    """
    # Windows does not remove a library that is loaded
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as place:
        alone = Path(place)
        # the folder of an export may hold files of others, which would be compiled too
        for file in written.files:
            copy = alone / file.relative_to(written.folder)
            copy.parent.mkdir(parents=True, exist_ok=True)
            with naming(copy):
                copy.write_bytes(file.read_bytes())
        try:
            build_library(alone, alone / library)
        except CompilerMissingError:
            raise MissingExtraError("a C compiler", "apt install gcc, or set CC") from None
        except CompilerFailedError as error:
            raise UnfitCompilerError(error.compiler, error.said, error.remedy) from None
        yield alone

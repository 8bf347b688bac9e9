"""Builds generated C with a compiler on this machine; objects are cached within the process."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import takewhile
from pathlib import Path
from tempfile import TemporaryDirectory

from backends.files.atomic_write import naming
from backends.files.c_compiler import (
    CompilerTooSlowError,
    complaints,
    find_compiler,
    has_room,
    installed_as,
    run_compiler,
)

LEVEL = "-O2"
"""Optimisation level of libraries that run on recordings of users."""

_INCLUDE = re.compile(r'^[ \t]*#[ \t]*include[ \t]*[<"]([^>"]+)', re.MULTILINE)


class CompilerFailedError(Exception):
    """The compiler rejected the sources, failed or timed out. `compiler` is the command up to the
    flags that msnn adds. `said` are the lines of its messages, or one line about the time limit; it
    is never empty. `remedy` is a suggestion for the user.
    """

    def __init__(
        self,
        command: Sequence[str],
        output: str,
        remedy: str = "cure what it complains of, or set CC to another compiler",
    ) -> None:
        super().__init__(f"{shlex.join(command)}\n{output}")
        self.compiler = shlex.join(takewhile(lambda word: not word.startswith("-std="), command))
        self.said = complaints(output) or output.splitlines() or ["it said nothing"]
        self.remedy = remedy


def build_library(
    folder: Path,
    library: Path,
    compiler: Sequence[str] | None = None,
    flags: Sequence[str] | None = None,
) -> Path:
    """Compiles `src/*.c` of a folder that `write_c` wrote to the shared library at path `library`;
    returns that path. `compiler` is a command (default: the compiler found on this machine);
    `flags` are its optimisation flags (default `-O2`). Raises CompilerMissingError and
    CompilerFailedError.
    """
    # contraction to fused operations would round differently from the interpreter
    own = (LEVEL,) if flags is None else flags
    head = [*(compiler or find_compiler()), "-std=c99", *own, "-ffp-contract=off", "-fPIC"]
    sources = sorted((folder / "src").glob("*.c"))
    return link_library(head, sources, [folder / "include"], library)


def link_library(
    head: Sequence[str],
    sources: Sequence[Path],
    folders: Sequence[Path],
    library: Path,
    *flags: str,
) -> Path:
    """Compiles sources and links them to the shared library at path `library`; returns that path.
    `head` is the compiler command with flags for compiling and linking, `folders` contain headers,
    `flags` are for linking only. Raises CompilerFailedError with the compiler's messages, also for
    a timeout.
    """
    installed = installed_as(tuple(head))
    with TemporaryDirectory(prefix="msnn-objects-") as place:
        objects: list[str] = []
        for path in sources:
            # the cache key has the contents, not the paths: temporary folders have new names
            texts: dict[Path, str] = {}
            _read(path, folders, texts)
            source = _Source(tuple(texts.values()), path, tuple(folders))
            copy = Path(place) / f"{path.stem}.o"
            made = _object(source, tuple(head), installed)
            with naming(copy):
                copy.write_bytes(made)
            objects.append(str(copy))
        # without the C library, the caller names the libraries
        usual = () if "-nostdlib" in head else ("-lm",)
        return compiled([*head, "-shared", *flags, *objects], library, *usual)


@dataclass(frozen=True, slots=True)
class _Source:
    """A C file with the texts of itself and its headers. Two are equal if the texts are, in any
    folder, so that a cached object file can be used again.
    """

    texts: tuple[str, ...]
    path: Path = field(compare=False)
    folders: tuple[Path, ...] = field(compare=False)


def _read(path: Path, folders: Sequence[Path], texts: dict[Path, str]) -> None:
    """Adds the text of the file and of the headers that it includes to `texts`, by path. Headers
    are searched next to the file and in `folders`; others, such as system headers, are skipped.
    """
    texts[path] = path.read_text(encoding="utf-8")
    for name in _INCLUDE.findall(texts[path]):
        beside = [folder / name for folder in (path.parent, *folders)]
        header = next((file.resolve() for file in beside if file.is_file()), None)
        if header is not None and header not in texts:
            _read(header, folders, texts)


# see decision 0364: a model is compiled for golden steps, for both FMI versions and for
# comparisons
@lru_cache(maxsize=256)
def _object(source: _Source, head: tuple[str, ...], _installed: tuple[int, ...]) -> bytes:
    with TemporaryDirectory(prefix="msnn-objects-") as place:
        result = Path(place) / "object.o"
        includes = [f"-I{folder}" for folder in source.folders]
        return compiled([*head, "-c", *includes, str(source.path)], result).read_bytes()


def compiled(command: Sequence[str], result: Path, *libraries: str) -> Path:
    """Runs a compiler command that writes the file `result`; returns that path. `libraries` are
    flags such as `-lm` that follow the output. Raises CompilerFailedError, and OSError for a full
    disk.
    """
    whole = [*command, "-o", str(result), *libraries]
    try:
        done = run_compiler(whole)
    except CompilerTooSlowError as error:
        raise CompilerFailedError(whole, f"it {error}", error.remedy) from None
    if done.code != 0:
        output = done.errors + done.output
        if not complaints(output):
            # a full disk also loses its messages
            has_room(result.parent)
        raise CompilerFailedError(whole, output)
    return result

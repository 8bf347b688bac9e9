"""Builds generated C with a compiler of this machine; a process compiles no file twice."""

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
from backends.files.c_compiler import find_compiler, installed_as
from backends.files.compiler_words import complaints
from backends.files.run_compiler import CompilerTooSlowError, has_room, run_compiler

LEVEL = "-O2"
"""How libraries are optimised that run along the records of users."""

_INCLUDE = re.compile(r'^[ \t]*#[ \t]*include[ \t]*[<"]([^>"]+)', re.MULTILINE)


class CompilerFailedError(Exception):
    """The compiler rejected the sources, could not work or hung.

    `compiler` is its command without our flags, `said` are its complaints or how long it had, at
    least one, and `remedy` is what may help.
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
    """Compiles the sources of a folder that `write_c` wrote into a shared library; its path.

    `flags` are those of `LEVEL` where none are given. Raises CompilerMissingError and
    CompilerFailedError.
    """
    # contraction to fused operations rounds once where the interpreter rounds twice: bits would
    # differ
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
    """A shared library of sources whose headers lie in `folders`; its path.

    `head` is the compiler with flags for compiling and linking, `flags` are for linking alone.
    Raises CompilerFailedError with what the compiler said, also where it takes too long.
    """
    installed = installed_as(tuple(head))
    with TemporaryDirectory(prefix="msnn-objects-") as place:
        objects: list[str] = []
        for path in sources:
            # the key of the cache holds what is read, never where it lies: temporary folders have
            # new names
            texts: dict[Path, str] = {}
            _read(path, folders, texts)
            source = _Source(tuple(texts.values()), path, tuple(folders))
            copy = Path(place) / f"{path.stem}.o"
            made = _object(source, tuple(head), installed)
            with naming(copy):
                copy.write_bytes(made)
            objects.append(str(copy))
        # who links no C library names the ones that he wants
        usual = () if "-nostdlib" in head else ("-lm",)
        return compiled([*head, "-shared", *flags, *objects], library, *usual)


@dataclass(frozen=True, slots=True)
class _Source:
    """A file of C and what it includes: alike files give one object wherever they lie."""

    texts: tuple[str, ...]
    path: Path = field(compare=False)
    folders: tuple[Path, ...] = field(compare=False)


def _read(path: Path, folders: Sequence[Path], texts: dict[Path, str]) -> None:
    """Adds the file and, of those that it includes, the ones that are not the system's.

    Two of them may have one name: `src/` has a header that sends to that of `include/`.
    """
    texts[path] = path.read_text(encoding="utf-8")
    for name in _INCLUDE.findall(texts[path]):
        beside = [folder / name for folder in (path.parent, *folders)]
        header = next((file.resolve() for file in beside if file.is_file()), None)
        if header is not None and header not in texts:
            _read(header, folders, texts)


# see decisions/0364: a model is compiled for its golden steps, for both versions of FMI and for
# comparisons
@lru_cache(maxsize=256)
def _object(source: _Source, head: tuple[str, ...], _installed: tuple[int, ...]) -> bytes:
    with TemporaryDirectory(prefix="msnn-objects-") as place:
        result = Path(place) / "object.o"
        includes = [f"-I{folder}" for folder in source.folders]
        return compiled([*head, "-c", *includes, str(source.path)], result).read_bytes()


def compiled(command: Sequence[str], result: Path, *libraries: str) -> Path:
    """The file that a command of the compiler writes. Raises CompilerFailedError and OSError."""
    whole = [*command, "-o", str(result), *libraries]
    try:
        done = run_compiler(whole)
    except CompilerTooSlowError as error:
        raise CompilerFailedError(whole, f"it {error}", error.remedy) from None
    if done.code != 0:
        output = done.errors + done.output
        if not complaints(output):
            # its words are kept where it writes: a full disk takes neither
            has_room(result.parent)
        raise CompilerFailedError(whole, output)
    return result

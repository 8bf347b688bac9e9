"""Compiles the C code of an export and its page harness to WebAssembly."""

from __future__ import annotations

from pathlib import Path

from backends.c.host.build import CompilerFailedError
from backends.files.c_compiler import CompilerTooSlowError, run_compiler, zig_program
from msnn.packages import ZIGLANG
from msnn.verification.builds.harness import TEMPLATES, write_harness
from msnn.verification.exported_c import ExportedC
from msnn.verification.sources import includes

_FLAGS = (
    "-target",
    "wasm32-freestanding",
    "-std=c99",
    "-O2",
    "-ffreestanding",
    "-fno-builtin",
    "-ffp-contract=off",
    "-nostdlib",
    "-Wl,--no-entry",
)
_ROOM = 4096
"""Bytes for messages after the golden steps."""


def web_assembly(model: ExportedC, folder: Path) -> bytes:
    """The WebAssembly module; `folder` receives the harness and intermediate files.

    The flags are those of the boards: no library, no fused operations. Raises MissingExtraError
    without zig, and CompilerFailedError if the C code needs a library.
    """
    ZIGLANG.require("compiles the model of a report to WebAssembly")
    zig = zig_program()
    assert zig is not None, "it is installed"
    write_harness("replay.h", model, folder)
    room = sum(len(line) + 8 for line in model.expected) + _ROOM
    main = write_harness("browser_main.c", model, folder, room=room)
    freestanding = TEMPLATES / "freestanding"
    sources = [*model.sources, main, freestanding / "library.c"]
    module = folder / "model.wasm"
    command = [
        *(str(zig), "cc", *_FLAGS),
        *(f"-I{freestanding}", f"-I{folder}", *includes(model)),
        *(str(path) for path in sources),
        *("-o", str(module)),
    ]
    try:
        done = run_compiler(command, folder=folder)
    except CompilerTooSlowError as error:
        raise CompilerFailedError(command, f"it {error}") from None
    if done.code != 0:
        raise CompilerFailedError(command, done.errors + done.output)
    return module.read_bytes()

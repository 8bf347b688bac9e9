"""Compiles the C code of an export for this machine and calls its step from Python."""

from __future__ import annotations

import ctypes
import re
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import PurePosixPath
from typing import Any, Literal

from numpy.typing import ArrayLike, NDArray

from backends.c.folder.file_texts import model_texts
from backends.c.host.library import CStep
from backends.c.interface.interface import Interface
from backends.c.interface.layout_metadata import layout_metadata
from backends.c_language.literals import Dtype
from backends.native.compile_kernel import compiled_kernel
from compiler.interpreter.interpreter import physical_weights
from compiler.ir.program import Program

Array = NDArray[Any]
_REALS: dict[Dtype, Any] = {"float32": ctypes.c_float, "float64": ctypes.c_double}


class NativeStep:
    """One instance of the C code of a program in step form, compiled for this machine. `inputs` and
    `outputs` are memory that the caller writes and reads: arrays of reals (ctypes), field after
    field in the order of the interface. `step()` runs one step and returns status bits. Raises
    ValueError for weights of a wrong shape, CompilerMissingError and KernelBuildError.
    """

    name: Literal["c", "interpreter"] = "c"

    def __init__(
        self, program: Program, interface: Interface, weights: Mapping[str, ArrayLike]
    ) -> None:
        physical = physical_weights(program, weights)
        texts = model_texts(program, interface, physical)
        texts.pop(
            f"src/{interface.prefix}_params.c", None
        )  # so that the code does not depend on weights
        text = one_text(texts)
        library = compiled_kernel(text).library
        layout = layout_metadata(program, interface, physical)["c"]
        real = _REALS[interface.options.dtype]
        self._c = CStep(layout, library, physical)
        self._ready = interface.ready if interface.has_state else None
        # a struct without fields has a dummy field
        self.inputs = (real * max(sum(input.field.size for input in interface.inputs), 1))()
        self.outputs = (real * max(sum(field.size for field in interface.outputs), 1))()
        function = library[
            f"{interface.prefix}_step"
        ]  # a separate function object with argument types
        addresses = (*self._c.instance, *map(ctypes.addressof, (self.inputs, self.outputs)))
        function.restype, function.argtypes = ctypes.c_uint32, [ctypes.c_void_p] * len(addresses)
        self.step: Callable[[], int] = partial(function, *addresses)
        self.init()

    def init(self) -> None:
        """Sets the states that need no recorded samples; the others stay marked as unset."""
        self._c.init()

    def reset(self, windows: Mapping[str, ArrayLike]) -> int:
        """Sets all states from samples around the first step; returns status bits. `windows` has
        the arguments of `reset` by name. Raises ValueError for missing or unknown names and wrong
        shapes.
        """
        return self._c.reset(windows)

    def states(self) -> dict[str, Array]:
        """The current states by name, in the shapes of the spec, buffers with the oldest sample
        first.
        """
        return self._c.states()

    def set_states(self, values: Mapping[str, ArrayLike]) -> None:
        """Sets all states by name, in the shapes of `states`. Raises KeyError if one is missing."""
        self._c.set_states(values)

    @property
    def waiting(self) -> int:
        """The bits of the field `ready` that mark buffers (1) and states (2) without valid
        values.
        """
        return 0 if self._ready is None else self._c.word(self._ready) & 3

    def no_longer_waits(self, bits: int) -> None:
        """Clears these bits of `waiting`: the buffers or states that they mean now have valid
        values.
        """
        if self._ready is not None:
            self._c.set_word(self._ready, self._c.word(self._ready) & ~bits)


def one_text(texts: Mapping[str, str]) -> str:
    """One C text from the files of a folder (path → text): headers, then sources, without the
    `#include` lines for files of the folder.
    """
    names = {PurePosixPath(path).name for path in texts}
    paths = [path for path in texts if path.startswith(("include/", "src/"))]
    ordered = sorted(paths, key=lambda path: (not path.startswith("include/"), path[-2:] != ".h"))
    own = re.compile(r'^#include "([^"]+)"$', re.MULTILINE)
    return "\n".join(
        own.sub(lambda found: "" if found[1] in names else found[0], texts[path])
        for path in ordered
    )

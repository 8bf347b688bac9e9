"""Writes a program as a standalone torch module, with its weights, to a folder."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Literal

from numpy.typing import ArrayLike

from backends.files.atomic_write import write_bytes, write_text
from backends.files.readme import one_line, readme_text
from backends.files.safetensors_bytes import safetensors_bytes
from backends.ports.step_interface import Port, step_interface
from backends.torch_module.source import torch_source
from compiler.interpreter.interpreter import physical_weights
from compiler.ir.program import Program


def write_torch(
    program: Program,
    weights: Mapping[str, ArrayLike] | None,
    folder: Path,
    prefix: str,
    dtype: Literal["float32", "float64"] = "float64",
) -> tuple[Path, ...]:
    """Writes `<prefix>.py`, `<prefix>.safetensors` and a README, `<prefix>_torch.md`.

    The program is in step form. `dtype` is the default precision of the module's `load`. Weights
    are physical float64 arrays; the default is the initial values. Returns the paths. Raises
    OSError if the folder is not writable, ValueError for a weight of a wrong shape.
    """
    # checked first, so that a wrong weight leaves no files
    arrays = physical_weights(program, weights or {})
    metadata = {"program": program.name, "spec_sha256": program.spec_hash}
    interface = step_interface(program)
    readme = readme_text(
        "torch",
        model=one_line(program.name),
        prefix=prefix,
        windows=_zeros(interface.start_windows, dtype),
        inputs=_zeros(interface.inputs, dtype),
    )
    return (
        write_text(folder / f"{prefix}.py", torch_source(program, prefix, dtype)),
        write_bytes(folder / f"{prefix}.safetensors", safetensors_bytes(arrays, metadata)),
        write_text(folder / f"{prefix}_torch.md", readme),
    )


def _zeros(ports: Iterable[Port], dtype: str) -> str:
    """Python source of a dictionary of zeros for the ports, with a batch of one."""
    entries = [
        f"{port.signal.name!r}: torch.zeros({(1, *port.type.shape)}, dtype=torch.{dtype})"
        for port in ports
    ]
    return f"{{{', '.join(entries)}}}"

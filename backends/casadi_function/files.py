"""Writes a program's CasADi functions, with a description of their ports, to a folder."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import version as metadata_of
from pathlib import Path

import casadi
from numpy.typing import ArrayLike

from backends.casadi_function.function import build_function, build_initial_state, casadi_names
from backends.casadi_function.options import CasadiOptions
from backends.casadi_function.source import LARGEST, source_text
from backends.files.atomic_write import replacing, write_text
from backends.files.readme import one_line, readme_text
from backends.ports.metadata import interface_metadata, metadata_text
from backends.ports.step_interface import step_interface
from compiler.ir import ops
from compiler.ir.program import Graph, Program
from compiler.passes.inline_parameters import inline_parameters

_AS_IT_IS = CasadiOptions()


def write_casadi(
    program: Program,
    weights: Mapping[str, ArrayLike] | None,
    folder: Path,
    prefix: str,
    options: CasadiOptions = _AS_IT_IS,
) -> tuple[Path, ...]:
    """Writes the CasADi functions of a program in step form; returns the paths.

    The files are `<prefix>.casadi`, `<prefix>_initial_state.casadi`, `<prefix>.json` and a README,
    `<prefix>_casadi.md`. Unless the functions are very large, `<prefix>_casadi.py` has both for any
    version of CasADi. Values of parameters, `weights` or the initial ones, are in the JSON file if
    parameters are inputs, otherwise in the functions. Raises OSError if the folder is not writable,
    ValueError for a weight of a wrong shape.
    """
    if options.params == "inline":
        program = inline_parameters(program, weights or {})
    names = casadi_names(program)
    of_inputs = weights if options.params == "input" else None
    metadata = interface_metadata(program, step_interface(program), names, of_inputs)
    step, initial_state = build_function(program, form=options.form), build_initial_state(program)
    source = None
    if max(_numbers(program.step), _numbers(program.start)) <= LARGEST:
        scalars = [build_function(program, form="sx"), build_initial_state(program, form="sx")]
        source = source_text(scalars, one_line(program.name))
    version = metadata_of("casadi")
    module = f"{prefix}_casadi.py"
    text = metadata_text(
        {
            **metadata,
            "casadi": version,
            "functions": {
                "step": f"{prefix}.casadi",
                "initial_state": f"{prefix}_initial_state.casadi",
                **({} if source is None else {"any_version": module}),
            },
        }
    )
    readme = readme_text(
        "casadi",
        model=one_line(program.name),
        prefix=prefix,
        version=version,
        source=source is not None,
    )
    return (
        _save(step, folder / f"{prefix}.casadi"),
        _save(initial_state, folder / f"{prefix}_initial_state.casadi"),
        write_text(folder / f"{prefix}.json", text),
        write_text(folder / f"{prefix}_casadi.md", readme),
        *(() if source is None else (write_text(folder / module, source),)),
    )


def _numbers(graph: Graph) -> int:
    """The number of elements that a graph computes, including the terms of sums."""
    return sum(
        node.type.size + sum(graph[arg].type.size for arg in node.args)
        if isinstance(node.op, ops.Reduction)
        else node.type.size
        for _, node in graph
    )


def _save(function: casadi.Function, path: Path) -> Path:
    # written to a temporary file and renamed, so that readers never see a partial file
    with replacing(path) as temporary:
        function.save(str(temporary))
    return path

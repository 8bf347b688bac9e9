"""Writes a program's CasADi functions to a folder, and as Python code for any version of CasADi."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from importlib.metadata import version as metadata_of
from pathlib import Path

import casadi
from numpy.typing import ArrayLike

from backends.casadi_function.function import build_function, build_initial_state, casadi_names
from backends.casadi_function.options import CasadiOptions
from backends.files.atomic_write import replacing, write_text
from backends.files.text_templates import one_line, readme_text
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
    """Writes the CasADi functions of a program in step form to `folder`; returns the paths.

    The files are `<prefix>.casadi`, `<prefix>_initial_state.casadi`, `<prefix>.json` and a README,
    `<prefix>_casadi.md`. Unless the functions are very large, `<prefix>_casadi.py` has both for any
    version of CasADi. `weights` are physical arrays by name; a missing one, or None, means initial
    values. They are in the JSON file if parameters are inputs, otherwise in the functions. Raises
    OSError if a file cannot be written, ValueError for a program in window form or a weight of a
    wrong shape.
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


LARGEST = 200_000
"""Maximum number of computed elements; Python reads a source of this size in seconds."""

# ids of operations differ between versions, names do not
_OPERATIONS: dict[int, str] = {
    getattr(casadi, name): name for name in dir(casadi) if name.startswith("OP_")
}


def source_text(functions: Sequence[casadi.Function], model: str) -> str:
    """The text of a Python module that defines these CasADi functions under their names, for any
    version of CasADi. `functions` are scalar (SX), and their inputs and outputs are columns.
    `model` is the name in the comment.
    """
    about = f"The CasADi functions of the model {model!r}, for any version of CasADi."
    lines = [
        f"# {about}",
        "",
        "import casadi",
        "from casadi import SX",
        "",
        "",
        "def _one(operation, a):",
        "    return SX.unary(getattr(casadi, operation), a)",
        "",
        "",
        "def _two(operation, a, b):",
        "    return SX.binary(getattr(casadi, operation), a, b)",
        "",
        "",
        "# terms such as 0 * x stay: of an infinite x they are NaN, as in the model",
        "_simplifies = casadi.GlobalOptions.getSimplificationOnTheFly()",
        "casadi.GlobalOptions.setSimplificationOnTheFly(False)",
    ]
    for function in functions:
        lines += ["", "", *_function(function)]
    lines += ["", ""]
    lines += [f"{function.name()} = _{function.name()}()" for function in functions]
    lines += ["casadi.GlobalOptions.setSimplificationOnTheFly(_simplifies)"]
    return "\n".join(lines) + "\n"


def _function(function: casadi.Function) -> list[str]:
    inputs, outputs = range(function.n_in()), range(function.n_out())
    lines = [f"def _{function.name()}():", f"    w = [None] * {function.sz_w()}"]
    lines += [f"    a{k} = SX.sym({function.name_in(k)!r}, {function.numel_in(k)})" for k in inputs]
    lines += [f"    r{k} = [SX(0)] * {function.numel_out(k)}" for k in outputs]
    rows: list[list[int]] = [function.sparsity_out(k).row() for k in outputs]
    for k in range(function.n_instructions()):
        name = _OPERATIONS[function.instruction_id(k)]
        to: list[int] = function.instruction_output(k)
        of: list[int] = function.instruction_input(k)
        match name:
            case "OP_CONST":
                line = f"w[{to[0]}] = SX({_number(function.instruction_constant(k))})"
            case "OP_INPUT":
                line = f"w[{to[0]}] = a{of[0]}[{of[1]}]"
            case "OP_OUTPUT":
                line = f"r{to[0]}[{rows[to[0]][to[1]]}] = w[{of[0]}]"
            case _:
                call = "_one" if len(of) == 1 else "_two"
                line = f"w[{to[0]}] = {call}({name!r}, {', '.join(f'w[{i}]' for i in of)})"
        lines.append(f"    {line}")
    arguments = ", ".join(f"a{k}" for k in inputs)
    results = ", ".join(f"casadi.vertcat(*r{k})" for k in outputs)
    names = f"{function.name_in()!r}, {function.name_out()!r}"
    options = '{"never_inline": True}'
    call = f"{function.name()!r}, [{arguments}], [{results}], {names}, {options}"
    return [*lines, f"    return casadi.Function({call})"]


def _number(value: float) -> str:
    return repr(value) if math.isfinite(value) else f'float("{value}")'

"""Writes CasADi functions as Python code for any version of CasADi.

A serialised function (`Function.save`) can be read by the version that wrote it and later ones
only.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import casadi

LARGEST = 200_000
"""Maximum number of computed elements; Python reads a source of this size in seconds."""

# ids of operations differ between versions, names do not
_OPERATIONS: dict[int, str] = {
    getattr(casadi, name): name for name in dir(casadi) if name.startswith("OP_")
}


def source_text(functions: Sequence[casadi.Function], model: str) -> str:
    """A module with a CasADi function of each name.

    `functions` are scalar (SX); their inputs and outputs are columns.
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

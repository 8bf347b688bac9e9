"""What every backend lowers, from the declarations and the tests that prove it."""

from __future__ import annotations

import ast
from pathlib import Path
from typing import get_args

from backends.casadi_function import function as casadi_function
from backends.onnx_model import draft as onnx_draft
from backends.torch_module.lowering import NATIVE_FUNCTIONS
from compiler.ir.ops import Op, ReadTraining
from compiler.ir.scalars import SCALAR_FUNCTIONS, SIGNATURES, ScalarFunction
from tests.docs.markdown import paragraph, table
from tests.every_op.records import OP_RECORDS, RECORDS

_ROOT = Path(__file__).parents[2]

LOWERINGS = {
    "interpreter": "compiler/interpreter/operations.py",
    "derivative": "compiler/differentiation/reverse_mode.py",
    "torch": "backends/torch_module/lowering.py",
    "CasADi": "backends/casadi_function/lowering.py",
    "ONNX": "backends/onnx_model/lowering.py",
    "C, kernels": "backends/c_lowering/graph.py",
}
"""Each column of the table and the file whose `match` it is."""


def lowered_by(path: str) -> set[str]:
    """Names of the operations that the patterns of a file's `match` statements have.

    A pattern may have a base class, which stands for all operations of that group.
    """
    tree = ast.parse((_ROOT / path).read_text(encoding="utf-8"))
    patterns = (node.cls for node in ast.walk(tree) if isinstance(node, ast.MatchClass))
    names = {p.attr if isinstance(p, ast.Attribute) else getattr(p, "id", "") for p in patterns}
    bases = {op.__name__: {base.__name__ for base in op.__mro__} for op in get_args(Op)}
    return {op for op, known in bases.items() if known & names}


def core_operations() -> str:
    """A row an operation of programs, a column a backend."""
    lowered = {column: lowered_by(path) for column, path in LOWERINGS.items()}
    rows: list[tuple[str, ...]] = []
    for op in get_args(Op):
        if op is ReadTraining:
            continue
        name = op.__name__
        cells = ["●" if name in known else "" for known in lowered.values()]
        own = [record for record in OP_RECORDS if record.rstrip("<>=") == name]
        count = sum(r.name.startswith("Apply") for r in RECORDS) if name == "Apply" else len(own)
        rows.append((f"`{name}`", paragraph(op.__doc__).split("\n")[0], *cells, str(count)))
    return table(("operation", "meaning", *lowered, "records"), rows)


def scalar_functions() -> str:
    """A row a scalar function, and how each backend has it."""
    header = ("function", "meaning", "unit", "torch", "CasADi", "ONNX", "C, float32")
    return table(header, [_function(row) for row in SCALAR_FUNCTIONS.values()])


def _function(row: ScalarFunction) -> tuple[str, ...]:
    having = (NATIVE_FUNCTIONS, casadi_function.NATIVE, onnx_draft.NATIVE)
    spellings = ["own" if row.name in names else "expanded" for names in having]
    kernel = "arithmetic" if row.kernel is None else "kernel"
    return f"`{row.name}`", row.doc, row.units.value, *spellings, kernel


def builtins() -> str:
    """A row a builtin of the language."""
    rows = [
        (f"`{name}`", builtin.wanted, ", ".join(f"`{k}=`" for k in builtin.keywords), builtin.doc)
        for name, builtin in SIGNATURES.items()
    ]
    return table(("builtin", "takes", "keywords", "meaning"), rows)

"""Every layer of the language, from the docstrings of its file."""

from __future__ import annotations

import ast
from pathlib import Path

import compiler.layers
from spec_schema.layers import Layer
from tests.docs.markdown import apart, paragraph

_FOLDER = Path(compiler.layers.__file__).parent


def layers() -> str:
    """A section a layer: what it is, then the formulas of its public functions."""
    return apart(*(_layer(name) for name in Layer.known_keys()))


def _layer(name: str) -> str:
    tree = ast.parse((_FOLDER / f"{name}.py").read_text(encoding="utf-8"))
    functions = [
        node
        for node in tree.body
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_")
    ]
    parts = [f"### `{name}`", _about(paragraph(ast.get_docstring(tree)), name)]
    for function in functions:
        text = paragraph(ast.get_docstring(function))
        parts.append(text if function.name == name else f"*{function.name}*: {text}")
    return apart(*parts)


def _about(text: str, name: str) -> str:
    said = text.removeprefix(f"`{name}`: ")
    return said[:1].upper() + said[1:]

"""Puts faults into the rules of differentiation, one at a time: reverse mode, forward mode,
tables.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any

from compiler.differentiation import forward_mode, reverse_mode, sensitivities, training_step
from compiler.ir.scalars import SCALAR_FUNCTIONS

_CALLS = {
    "add": "subtract",
    "subtract": "add",
    "multiply": "divide",
    "divide": "multiply",
    "minimum": "maximum",
}
_RELATIONS = {"LESS_EQUAL": "GREATER", "LESS": "GREATER_EQUAL", "GREATER_EQUAL": "LESS"}
_RELATIONS |= {"GREATER": "LESS_EQUAL"}
_FACTOR = 1.01
"""Of a derivative in the table: one that is a hundredth wrong, and where it is 0 not 0."""


@dataclass(frozen=True, slots=True)
class RuleMutant:
    """A fault in a rule, and a context in which the faulty rule is used."""

    where: str
    change: str
    applied: Callable[[], Any]
    """A context in which graphs are made with it."""


def derivative_mutants() -> Iterator[RuleMutant]:
    """Every mutant of reverse mode, of forward mode and of the table of derivatives."""
    yield from _of_module(reverse_mode, training_step, ("step_gradients",))
    yield from _of_module(forward_mode, sensitivities, ("tangents", "zero_tangent"))
    for name, row in SCALAR_FUNCTIONS.items():
        for position in range(row.arity):
            yield RuleMutant(
                "table",
                f"∂{name}/∂{position} · {_FACTOR} + {_FACTOR - 1:.2f}",
                lambda n=name, p=position: _scaled(n, p),
            )


def _of_module(
    module: ModuleType, user: ModuleType, names: tuple[str, ...]
) -> Iterator[RuleMutant]:
    path = Path(str(module.__file__))
    source = path.read_text(encoding="utf-8")
    count = len(list(_places(ast.parse(source))))
    for number in range(count):
        tree = ast.parse(source)
        node, change = list(_places(tree))[number]
        line = source.splitlines()[node.lineno - 1].strip()
        said = change()
        text = ast.unparse(ast.fix_missing_locations(tree))
        where = f"{path.stem}:{node.lineno} {line}"
        yield RuleMutant(where, said, lambda t=text: _replaced(t, path.stem, user, names))


def _places(tree: ast.Module) -> Iterator[tuple[Any, Callable[[], str]]]:
    """Yields the nodes of a syntax tree that can be changed, each with a function that
    changes it.
    """
    asked = _questions(tree)
    for node in ast.walk(tree):
        match node:
            case ast.Call(func=ast.Attribute(attr=name)) if name in _CALLS and len(node.args) == 2:
                yield node, lambda n=node, o=name: _renamed(n.func, "attr", o, _CALLS[o])
            case ast.Call(func=ast.Attribute(attr="negate")):
                yield node, lambda n=node: _without_sign(n)
            case ast.Attribute(value=ast.Name(id="Relation"), attr=name):
                yield node, lambda n=node, o=name: _renamed(n, "attr", o, _RELATIONS[o])
            case ast.Subscript(value=ast.Name(id="args"), slice=ast.Constant(value=0 | 1 as i)) if (
                node not in asked
            ):
                yield node, lambda n=node, i=i: _renamed(n.slice, "value", i, 1 - i)
            case ast.Compare(left=ast.Name(id="position"), ops=[ast.Eq()]):
                yield node, lambda n=node: _other_way(n)
            case ast.BinOp(op=ast.Sub(), left=ast.Constant(value=1)):
                yield node, lambda n=node: _renamed(n.left, "value", 1, 2)
            case ast.keyword(arg="when", value=ast.Constant(value=True)):
                yield node.value, lambda n=node: _renamed(n.value, "value", True, False)
            case _:
                pass


def _questions(tree: ast.Module) -> set[ast.AST]:
    """The uses of `infinite_values`, which only decide where a factor 0 is looked for.

    Graphs of finite derivatives do not show faults there;
    tests/training/engines/test_infinite_slopes.py does.
    """
    return {
        arg
        for call in ast.walk(tree)
        if isinstance(call, ast.Call) and "infinite_values" in ast.unparse(call.func)
        for arg in call.args
    }


def _renamed(node: Any, field: str, before: object, after: object) -> str:
    setattr(node, field, after)
    return f"{before} -> {after}"


def _other_way(node: ast.Compare) -> str:
    node.ops = [ast.NotEq()]
    return "== -> !="


def _without_sign(node: ast.Call) -> str:
    """`b.negate(x)` becomes `(lambda x: x)(x)`."""
    node.func = ast.parse("(lambda x: x)", mode="eval").body
    return "negate -> nothing"


@contextmanager
def _replaced(text: str, name: str, user: ModuleType, names: tuple[str, ...]) -> Iterator[None]:
    """A context in which the module `user` uses the functions of a changed module."""
    changed = ModuleType(f"changed_{name}")
    sys.modules[changed.__name__] = changed  # dataclasses look their module up
    exec(compile(text, name, "exec"), changed.__dict__)  # noqa: S102  (our own file, changed)
    before = {each: getattr(user, each) for each in names}
    try:
        for each in names:
            setattr(user, each, getattr(changed, each))
        yield
    finally:
        for each, value in before.items():
            setattr(user, each, value)
        del sys.modules[changed.__name__]


@contextmanager
def _scaled(name: str, position: int) -> Iterator[None]:
    row = SCALAR_FUNCTIONS[name]
    right = row.derivatives[position]

    def wrong(builder: Any, args: Any, value: Any) -> Any:
        slope = right(builder, args, value)
        more = builder.constant(_FACTOR - 1.0, unit=None)
        return builder.add(slope, builder.add(builder.multiply(slope, more), more))

    derivatives = (*row.derivatives[:position], wrong, *row.derivatives[position + 1 :])
    SCALAR_FUNCTIONS[name] = replace(row, derivatives=derivatives)
    try:
        yield
    finally:
        SCALAR_FUNCTIONS[name] = row

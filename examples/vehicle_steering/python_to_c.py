"""Translates the plain mathematics of a Python package to C, so that a car runs faster than time.

It knows what CommonRoad's vehicle models are written in: assignments, lists that grow by `append`,
`if`, `for` over a range, functions of `math`, calls of further functions of the package, and
attributes of a parameter object `p`, which become the numbers of an array. Anything else is an
error, so that nothing is translated wrong in silence.
"""

import ast
import inspect
import textwrap
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

_OPERATORS: dict[type, str] = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/",
    ast.Lt: "<", ast.Gt: ">", ast.LtE: "<=", ast.GtE: ">=",
    ast.And: "&&", ast.Or: "||",
}  # fmt: skip


@dataclass
class Translation:
    """The C functions so far, and the attributes of `p` in the order of the array."""

    untaken: frozenset[str]
    """Conditions, as Python text, that are taken to be false: their branch is left out."""
    functions: dict[str, str] = field(default_factory=dict[str, str])
    lengths: dict[str, int] = field(default_factory=dict[str, int])
    """The length of the list that a function returns, for those that return one."""
    attributes: list[str] = field(default_factory=list[str])

    def text(self) -> str:
        """All functions, those that are called first."""
        return "#include <math.h>\n\n" + "\n\n".join(self.functions.values()) + "\n"


def translate(function: Callable[..., Any], untaken: frozenset[str]) -> Translation:
    """A function of lists and of a parameter object `p`, as C that writes its list to `result`."""
    translation = Translation(untaken)
    _Function(translation, function, "").translated()
    return translation


class _Function:
    """One function on its way to C."""

    def __init__(self, whole: Translation, function: Callable[..., Any], prefix: str) -> None:
        self._whole, self._python, self._prefix = whole, function, prefix
        tree = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
        assert isinstance(tree, ast.FunctionDef)
        self._tree = tree
        self._lists: dict[str, int] = {}  # lists that the function makes, and their length so far
        self._names: set[str] = set()
        arguments = [argument.arg for argument in tree.args.args]
        subscripts = [n for n in ast.walk(tree) if isinstance(n, ast.Subscript)]
        indexed = {n.value.id for n in subscripts if isinstance(n.value, ast.Name)}
        self._arrays = [name for name in arguments if name in indexed]
        self._arguments = [name for name in arguments if name != "p"]

    def translated(self) -> None:
        """Adds the function, and those that it calls before it."""
        body = [line for statement in self._tree.body for line in self._statement(statement)]
        name = self._tree.name
        declared = [f"double {x};" for x in sorted(self._names - set(self._arguments))]
        declared += [f"double {x}[{n}];" for x, n in self._lists.items() if x != self._returned()]
        given = [f"double *{x}" if x in self._arrays else f"double {x}" for x in self._arguments]
        if self._returned():
            self._whole.lengths[name] = self._lists[self._returned()]
            given.append(f"double *{self._returned()}")
        head = f"static {'void' if self._returned() else 'double'} {name}"
        lines = [f"{head}({', '.join([*given, 'const double *p'])})", "{", *declared, *body, "}"]
        self._whole.functions[name] = "\n".join(lines)

    def _returned(self) -> str:
        """The name of the list that the function returns; empty where it returns a number."""
        value = self._tree.body[-1]
        name = (
            value.value.id
            if isinstance(value, ast.Return) and isinstance(value.value, ast.Name)
            else ""
        )
        return name if name in self._lists else ""

    def _statement(self, node: ast.stmt) -> list[str]:
        match node:
            case ast.Expr(value=ast.Constant(value=str())):  # a docstring
                return []
            case ast.Assign(targets=[ast.Name(id=name)], value=ast.List(elts=[])):
                self._lists[name] = 0
                return []
            case ast.Expr(
                value=ast.Call(
                    func=ast.Attribute(value=ast.Name(id=name), attr="append"), args=[value]
                )
            ):
                self._lists[name] += 1
                return [f"{name}[{self._lists[name] - 1}] = {self._number(value)};"]
            case ast.Assign(targets=[ast.Name(id=name)], value=ast.Call() as call) if (
                length := self._returns_list(call)
            ):
                self._lists[name] = length
                return [self._call(call, name) + ";"]
            case ast.Assign(targets=[ast.Name(id=name)], value=value):
                self._names.add(name)
                return [f"{name} = {self._number(value)};"]
            case ast.Assign(targets=[ast.Subscript() as place], value=value):
                return [f"{self._number(place)} = {self._number(value)};"]
            case ast.AugAssign(target=ast.Name(id=name), op=op, value=value):
                return [f"{name} {_OPERATORS[type(op)]}= {self._number(value)};"]
            case ast.If(test=test, orelse=otherwise) if ast.unparse(test) in self._whole.untaken:
                return [line for inner in otherwise for line in self._statement(inner)]
            case ast.If(test=test, body=body, orelse=otherwise):
                before = dict(self._lists)
                lines = [
                    f"if ({self._number(test)}) {{",
                    *self._block(body),
                    "} else {",
                    *self._block(otherwise),
                    "}",
                ]
                assert self._lists == before, "a list grows in a branch"
                return lines
            case ast.For(
                target=ast.Name(id=name),
                body=body,
                iter=ast.Call(func=ast.Name(id="range"), args=[first, end]),
            ):
                bounds = f"int {name} = {ast.unparse(first)}; {name} < {ast.unparse(end)}"
                return [f"for ({bounds}; {name}++) {{", *self._block(body), "}"]
            case ast.Return(value=ast.Name(id=name)) if name in self._lists:
                return []
            case ast.Return(value=ast.expr() as value):
                return [f"return {self._number(value)};"]
            case _:
                raise NotImplementedError(f"{self._tree.name}: {ast.unparse(node)}")

    def _block(self, body: list[ast.stmt]) -> list[str]:
        return [line for inner in body for line in self._statement(inner)]

    def _number(self, node: ast.expr) -> str:
        match node:
            case ast.Constant(value=int() | float() as value):
                return repr(float(value))
            case ast.Name(id=name):
                return name
            case ast.Attribute() if ast.unparse(node).startswith("p."):
                return f"p[{self._attribute(ast.unparse(node)[2:])}]"
            case ast.Subscript(value=ast.Name(id=name), slice=place):
                return f"{name}[{ast.unparse(place)}]"
            case ast.BinOp(left=left, op=ast.Pow(), right=ast.Constant(value=2)):
                square = self._number(left)
                return f"(({square})*({square}))"
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
                return f"({self._number(left)} {_OPERATORS[type(op)]} {self._number(right)})"
            case ast.UnaryOp(op=ast.USub(), operand=value):
                return f"(-{self._number(value)})"
            case ast.BoolOp(op=op, values=values):
                return f" {_OPERATORS[type(op)]} ".join(f"({self._number(v)})" for v in values)
            case ast.Compare(left=left, ops=[op], comparators=[right]):
                return f"{self._number(left)} {_OPERATORS[type(op)]} {self._number(right)}"
            case ast.Call(func=ast.Attribute(value=ast.Name(id="math"), attr=name), args=args):
                return f"{name}({', '.join(map(self._number, args))})"
            case ast.Call(func=ast.Name(id="abs"), args=[value]):
                return f"fabs({self._number(value)})"
            case ast.Call():
                return self._call(node, None)
            case _:
                raise NotImplementedError(f"{self._tree.name}: {ast.unparse(node)}")

    def _call(self, node: ast.Call, result: str | None) -> str:
        """A call of another function of the package, which is translated first."""
        name = self._callee(node).__name__
        parameters = [ast.unparse(a) for a in node.args if ast.unparse(a).split(".")[0] == "p"]
        values = [self._number(a) for a in node.args if ast.unparse(a) not in parameters]
        return f"{name}({', '.join([*values, *([result] if result else []), 'p'])})"

    def _returns_list(self, node: ast.Call) -> int:
        """The length of the list that the called function returns; 0 for a number."""
        if not ast.unparse(node.func).startswith("math."):
            name = self._callee(node).__name__
            return self._whole.lengths.get(name, 0)
        return 0

    def _callee(self, node: ast.Call) -> Callable[..., Any]:
        """The Python function that a call means, translated if it was not before."""
        scope: Any = inspect.getmodule(self._python)
        for part in ast.unparse(node.func).split("."):
            scope = getattr(scope, part)
        if scope.__name__ not in self._whole.functions:
            given = [ast.unparse(a) for a in node.args if ast.unparse(a).split(".")[0] == "p"]
            below = f"{self._prefix}{given[0][2:]}." if given and given[0] != "p" else self._prefix
            _Function(self._whole, scope, below).translated()
        return scope

    def _attribute(self, name: str) -> int:
        path = self._prefix + name
        if path not in self._whole.attributes:
            self._whole.attributes.append(path)
        return self._whole.attributes.index(path)

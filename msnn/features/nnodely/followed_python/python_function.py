"""Interprets a Python function on terms, statement by statement, without running it."""

from __future__ import annotations

import ast
import warnings
from collections.abc import Sequence
from types import EllipsisType
from typing import Any, cast

import numpy as np

from msnn.features.nnodely import arrays
from msnn.features.nnodely.arrays import ROWS, Elements, NotTranslatedError
from msnn.features.nnodely.followed_python.python_numbers import (
    BUILTINS,
    COMPARED,
    OPERATORS,
    called,
    compared,
    folded,
    has_length,
    is_number,
    kind_of,
    lengthened,
    shares,
)
from msnn.features.nnodely.followed_python.torch_calls import (
    Tensor,
    elementwise,
    is_tensor,
    method,
    shape_of,
    torch_function,
)
from msnn.features.nnodely.followed_python.torch_names import (
    LOWERED,
    MODULES,
    Module,
    imported,
    negative,
)
from msnn.features.nnodely.terms import Named, Term, minus, text_of_whole

_MOST_STEPS = 400_000
"""Maximum number of interpreted statements, operations and tensor elements."""
_LOWERED = {"true": True, "false": False, "null": None}
"""Words that nnodely converts to lower case when it saves source code."""


def follow(function: ast.FunctionDef, arguments: Sequence[Tensor], rows: int = 1) -> Tensor:
    """Interprets a function of a saved model with tensors of terms as arguments, without running
    it; returns the result as a tensor of terms.

    The limit of statements grows with `rows`, the number of rows evaluated together. Raises
    FunctionError for unsupported parts, and NeedsElementsError if an operation needs the elements
    of a `Whole`.
    """
    names = argument_names(function)
    if len(names) != len(arguments):
        raise FunctionError(
            function.lineno, f"it takes {len(names)} arguments and gets {len(arguments)}"
        )
    # no globals and no builtins but those of tables
    run = _Run(dict(zip(names, arguments, strict=True)), rows)
    returned = run.block(function.body)
    if returned is None:
        raise FunctionError(function.lineno, "it returns nothing")
    value = returned[0]
    if is_number(value):
        return arrays.tensor(value)
    if not is_tensor(value):
        raise FunctionError(function.lineno, "it returns no tensor")
    return cast("Tensor", value)


class _Run:
    def __init__(self, names: dict[str, Any], rows: int) -> None:
        self._names, self._given = names, [*names.values()]
        self._rows = rows
        self._line = 1
        self._steps = 0

    def block(self, statements: Sequence[ast.stmt]) -> tuple[Any] | None:
        """Interprets statements; returns the value of a `return` in a tuple of one, or None if
        there was none.
        """
        for statement in statements:
            self._line = statement.lineno
            self._count()
            match statement:
                case ast.Return(value=ast.expr() as value):
                    return (self._expression(value),)
                case ast.Expr(value=ast.Constant()) | ast.Pass():
                    pass
                case (
                    ast.Assign(targets=[target], value=value)
                    | ast.AnnAssign(target=target, value=ast.expr() as value)
                ):
                    self._assign(target, self._expression(value))
                case ast.AugAssign(target=ast.Name() as target, op=op, value=value):
                    left = self._name(target)
                    # in torch `a += 1` changes the tensor, whoever else holds it
                    others = [held for name, held in self._names.items() if name != target.id]
                    if shares(left, [*self._given, *others]):
                        raise self._refused("an assignment in place to what others share")
                    self._names[target.id] = self._binary(op, left, self._expression(value))
                case ast.If(test=test, body=body, orelse=orelse):
                    # one branch alone is followed: the other may not even be translatable
                    found = self.block(body if self._known(test) else orelse)
                    if found is not None:
                        return found
                case ast.For(target=target, iter=source, body=body, orelse=[]):
                    for item in self._items(source):
                        self._assign(target, item)
                        found = self.block(body)
                        if found is not None:
                            return found
                case ast.Import() | ast.ImportFrom():
                    try:
                        self._names |= imported(statement)
                    except NotTranslatedError as fault:
                        raise self._refused(str(fault)) from None
                case _:
                    raise self._refused(f"a statement `{kind_of(statement)}`")
        return None

    def _expression(self, node: ast.expr) -> Any:
        self._count()
        try:
            found = self._evaluated(node)
        except NotTranslatedError as fault:
            raise self._refused(str(fault)) from None
        except (IndexError, ValueError, TypeError, ZeroDivisionError, OverflowError, KeyError):
            raise self._refused("operands that do not fit") from None
        except RecursionError:
            raise self._refused("it is nested too deep") from None
        # large tensors take as long as many statements
        self._count(cast("arrays.Elements", found).size if isinstance(found, np.ndarray) else 0)
        return cast("Any", found)

    def _evaluated(self, node: ast.expr) -> Any:
        self._line = getattr(node, "lineno", self._line)
        match node:
            case ast.Constant(
                value=bool() | int() | float() | str() | EllipsisType() | None as value
            ):
                return value
            case ast.Name():
                return self._name(node)
            case ast.BinOp(left=left, op=op, right=right):
                return self._binary(op, self._expression(left), self._expression(right))
            case ast.UnaryOp(op=op, operand=operand):
                return self._unary(op, self._expression(operand))
            case ast.Compare(left=left, ops=[op], comparators=[right]):
                return self._compare(op, self._expression(left), self._expression(right))
            case ast.IfExp(test=test, body=body, orelse=orelse):
                return self._expression(body if self._known(test) else orelse)
            case ast.Tuple(elts=items) | ast.List(elts=items):
                return [self._expression(item) for item in items]
            case ast.Call():
                return self._call(node)
            case ast.Attribute(value=value, attr=name):
                return self._member(self._expression(value), name)
            case ast.Subscript(value=value, slice=index):
                return self._element(self._expression(value), self._index(index))
            case ast.ListComp(elt=item, generators=[ast.comprehension(ifs=[]) as loop]):
                made: list[Any] = []
                items, outer = self._items(loop.iter), self._names
                # the loop has names of its own, which end with it
                self._names = {**outer}
                for each in items:
                    self._assign(loop.target, each)
                    made.append(self._expression(item))
                self._names = outer
                return made
            case _:
                raise self._refused(f"an expression `{kind_of(node)}`")

    def _name(self, node: ast.Name) -> Any:
        if node.id in self._names:
            return self._names[node.id]
        if node.id in LOWERED:
            return LOWERED[node.id]
        if node.id in MODULES:
            return Module(node.id)
        if node.id in BUILTINS:
            return Module(f"builtins.{node.id}")
        raise self._refused(f"the name `{node.id}`")

    def _member(self, value: Any, name: str) -> Any:
        if isinstance(value, Module):
            return value.member(name)
        if is_tensor(value):
            match name:
                case "shape":
                    return shape_of(value)
                case "ndim":
                    return len(shape_of(value))
                case "T" | "mT":
                    return method("t", [value], {})
                case "dtype" | "device":
                    return None
                case _:
                    pass
        raise self._refused(f"the member `{name}`")

    def _call(self, node: ast.Call) -> Any:
        keywords = {word.arg: self._expression(word.value) for word in node.keywords if word.arg}
        if len(keywords) != len(node.keywords) or any(
            isinstance(one, ast.Starred) for one in node.args
        ):
            raise self._refused("arguments with stars")
        if isinstance(node.func, ast.Attribute):
            owner = self._expression(node.func.value)
            # `x.abs(…)` is looked for by its name: attributes of Python objects are never read
            if is_tensor(owner):
                arguments = [owner, *(self._expression(one) for one in node.args)]
                return method(node.func.attr, arguments, keywords)
        function = self._expression(node.func)
        arguments = [self._expression(one) for one in node.args]
        if not isinstance(function, Module):
            raise self._refused("a call of what is no function of torch")
        owner, _, name = function.path.rpartition(".")
        if owner == "builtins" and not keywords:
            return called(name, arguments)
        return torch_function(owner, name, arguments, keywords)

    def _binary(self, op: ast.operator, left: Any, right: Any) -> Any:
        if is_number(left) and is_number(right):
            return folded(op, left, right)
        if isinstance(left, list) and isinstance(right, list) and isinstance(op, ast.Add):
            return lengthened(cast("list[Any]", left), cast("list[Any]", right))
        if isinstance(op, ast.MatMult):
            return torch_function("torch", "matmul", [left, right], {})
        if type(op) in OPERATORS:
            return elementwise(OPERATORS[type(op)], left, right)
        raise self._refused(f"the operator `{kind_of(op)}`")

    def _unary(self, op: ast.unaryop, value: Any) -> Any:
        match op:
            case ast.USub():
                return -value if is_number(value) else elementwise(negative, value)
            case ast.UAdd():
                return value
            case ast.Not() if is_number(value) or value is None:
                return not value
            # truth is 0 or 1 in terms: `~a` is 1 − a
            case ast.Invert() if not is_number(value):
                return elementwise(minus, 1, value)
            case _:
                raise self._refused(f"the operator `{kind_of(op)}`")

    def _compare(self, op: ast.cmpop, left: Any, right: Any) -> Any:
        if isinstance(op, ast.Is | ast.IsNot):
            return (left is right) == isinstance(op, ast.Is)
        if not (is_tensor(left) or is_tensor(right)):
            return compared(op, left, right)
        if type(op) in COMPARED:
            return torch_function("torch", COMPARED[type(op)], [left, right], {})
        raise self._refused(f"the comparison `{kind_of(op)}`")

    def _known(self, test: ast.expr) -> bool:
        found = self._expression(test)
        if is_tensor(found) or isinstance(found, Module):
            # the source is followed once, for all values of the data
            raise self._refused("a choice by values of the data; `torch.where` is translated")
        return bool(found)

    def _items(self, node: ast.expr) -> list[Any]:
        found = self._expression(node)
        if not isinstance(found, list):
            raise self._refused("a loop over what is no `range` and no list")
        return cast("list[Any]", found)

    def _assign(self, target: ast.expr, value: Any) -> None:
        match target:
            case ast.Name(id=name):
                self._names[name] = value
            case ast.Tuple(elts=items) if has_length(value, len(items)):
                for item, one in zip(items, value, strict=True):
                    self._assign(item, one)
            case _:
                raise self._refused("an assignment that names do not fit")

    def _index(self, node: ast.expr) -> Any:
        match node:
            case ast.Tuple(elts=items):
                return tuple(self._index(item) for item in items)
            case ast.Slice(lower=lower, upper=upper, step=step):
                bounds = (lower, upper, step)
                return slice(*(None if x is None else self._expression(x) for x in bounds))
            case _:
                return self._expression(node)

    def _element(self, value: Any, index: Any) -> Any:
        if is_tensor(value):
            return method("__getitem__", [value, index], {})
        if not isinstance(value, list):
            raise self._refused("an index of what is no tensor")
        return cast("list[Any]", value)[index]

    def _count(self, elements: int = 0) -> None:
        self._steps += 1 + elements
        # source of a file may loop as long as it likes; what is followed ends
        if self._steps > _MOST_STEPS * self._rows:
            raise self._refused(f"it takes more than {_MOST_STEPS:,} steps")

    def _refused(self, reason: str) -> FunctionError:
        return FunctionError(self._line, reason)


def refuse_mixed_rows(
    function: ast.FunctionDef, shapes: Sequence[tuple[int, int]], own: Sequence[Elements]
) -> None:
    """Raises FunctionError for a function whose result in one row of the batch depends on other
    rows of its arguments.

    `shapes` are (samples, elements) of its streams; `own` are its parameter arrays.
    """
    alone, among = (_followed(function, rows, shapes, own) for rows in (1, ROWS))
    # no batch at all: what follows the function refuses it with its shape
    if alone.ndim != 3 or alone.shape[0] != 1:
        return
    # compared as texts: terms are equal by identity alone
    is_separate = among.shape == (ROWS, *alone.shape[1:]) and _texts(alone) == _texts(among)
    if not is_separate:
        reason = "its value depends on the other samples that are evaluated with one"
        raise FunctionError(function.lineno, reason)


def _followed(
    function: ast.FunctionDef,
    rows: int,
    shapes: Sequence[tuple[int, int]],
    own: Sequence[Elements],
) -> Elements:
    streams = [_symbols(rows, i, shape) for i, shape in enumerate(shapes)]
    found = follow(function, [*streams, *own], rows)
    assert isinstance(found, np.ndarray)
    return found


def _symbols(rows: int, argument: int, shape: tuple[int, int]) -> Elements:
    """An argument of shape (rows, *shape) whose elements are terms with distinct names. Rows are
    numbered so that the middle one is row 0, to compare results for different numbers of rows.
    """
    out = np.empty((rows, *shape), dtype=object)
    for row, sample, i in np.ndindex(*out.shape):
        out[row, sample, i] = Term(Named(f"x{argument} {row - rows // 2} {sample} {i}"))
    return out


def _texts(found: Elements) -> list[str]:
    middle = found[len(found) // 2]
    return [text_of_whole(one) if isinstance(one, Term) else str(one) for one in middle.ravel()]


_LONGEST = 20_000


class FunctionError(Exception):
    """A part of a function that is not supported: its line, counted from 1, and the reason."""

    def __init__(self, line: int, reason: str) -> None:
        super().__init__(reason)
        self.line = line
        self.reason = reason


def parse_function(code: str, name: str) -> ast.FunctionDef:
    """The syntax tree of the function `name` in a source text. Raises FunctionError for a text that
    is not exactly this function with plain arguments.
    """
    if len(code) > _LONGEST:
        raise FunctionError(1, f"it has more than {_LONGEST:,} characters")
    try:
        with warnings.catch_warnings():
            # source of strangers may have invalid escapes, of which Python would warn on stderr
            warnings.simplefilter("ignore")
            body = ast.parse(code).body
    except (RecursionError, MemoryError):
        raise FunctionError(1, "it is nested too deep") from None
    # ValueError: null bytes, or halves of surrogate pairs
    except (SyntaxError, ValueError) as fault:
        line = getattr(fault, "lineno", None) or 1
        raise FunctionError(line, "it is not Python") from None
    if len(body) != 1 or not isinstance(body[0], ast.FunctionDef):
        raise FunctionError(1, "its source is more than one function")
    function = body[0]
    arguments = function.args
    if function.name != name:
        raise FunctionError(function.lineno, f"it is called `{function.name}`, not `{name}`")
    if function.decorator_list:
        raise FunctionError(function.lineno, "it has a decorator")
    if arguments.vararg or arguments.kwarg or arguments.kwonlyargs or arguments.defaults:
        raise FunctionError(function.lineno, "its arguments have defaults or stars")
    return function


def argument_names(function: ast.FunctionDef) -> list[str]:
    """The names of the arguments in order."""
    return [one.arg for one in (*function.args.posonlyargs, *function.args.args)]


def with_arguments_last(function: ast.FunctionDef, last: Sequence[bool]) -> ast.FunctionDef:
    """The function with some of its first arguments moved back: `last[i]` is True if argument i
    goes behind those for which it is False. Raises FunctionError if it has too few arguments.
    """
    args = [*function.args.posonlyargs, *function.args.args]
    if len(args) < len(last):
        wanted = f"it takes {len(args)} arguments and gets {len(last)}"
        raise FunctionError(function.lineno, wanted)
    # False sorts first, and sorted() is stable: both groups keep their order
    order = sorted(range(len(last)), key=lambda place: last[place])
    moved = ast.FunctionDef(
        name=function.name,
        args=ast.arguments(
            posonlyargs=[],
            args=[*(args[place] for place in order), *args[len(last) :]],
            kwonlyargs=[],
            kw_defaults=[],
            defaults=[],
        ),
        body=function.body,
        decorator_list=[],
    )
    return ast.copy_location(moved, function)

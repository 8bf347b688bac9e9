"""Parses the source text of one Python function, and locates unsupported parts."""

from __future__ import annotations

import ast
import warnings
from collections.abc import Sequence

_LONGEST = 20_000


class FunctionError(Exception):
    """The line of the first unsupported part of a function, from 1, and the reason."""

    def __init__(self, line: int, reason: str) -> None:
        super().__init__(reason)
        self.line = line
        self.reason = reason


def parse_function(code: str, name: str) -> ast.FunctionDef:
    """The function in a source text. Raises FunctionError for any other text."""
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
    """The function with some of its first arguments behind the others of these."""
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

"""Computes the maximum stack of a function from the call graphs written by gcc."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

_NODE = re.compile(r'node: \{ title: "([^"]+)" label: "([^"]*)"')
_EDGE = re.compile(r'edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"')
# "dynamic" without a bound does not match: such a function has no known need
_BYTES = re.compile(r"(\d+) bytes \((static|dynamic,bounded)\)")
_WITHOUT_STACK = ("memcpy", "memset", "memmove")
"""Routines that the compiler inserts for copies; leaf functions with a few words of stack."""
_LEAF = 16


def stack_bound(graphs: Sequence[Path], function: str) -> int | None:
    """Stack of `function` in bytes, including all functions that it calls.

    None for recursion, or if it calls a library routine with unknown stack.
    """
    text = "\n".join(path.read_text(encoding="utf-8") for path in graphs)
    own = {
        _plain(title): int(stated[1])
        for title, label in _NODE.findall(text)
        if (stated := _BYTES.search(label))
    }
    own |= dict.fromkeys(_WITHOUT_STACK, _LEAF)
    calls: dict[str, set[str]] = {}
    for caller, called in _EDGE.findall(text):
        calls.setdefault(_plain(caller), set()).add(_plain(called))

    def depth(name: str, above: tuple[str, ...]) -> int | None:
        # calls through pointers go to a node `__indirect_call` of no size, and end here too
        if name in above or name not in own:
            return None
        below = [depth(called, (*above, name)) for called in sorted(calls.get(name, ()))]
        # frames of callees never stand on the stack together
        known = [bytes for bytes in below if bytes is not None]
        return own[name] + max(known, default=0) if len(known) == len(below) else None

    return depth(function, ())


def _plain(title: str) -> str:
    """The name of a function; gcc prefixes static functions by their file."""
    return title.rsplit(":", 1)[-1]

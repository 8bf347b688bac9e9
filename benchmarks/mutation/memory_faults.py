"""Faults in what generated C remembers: nothing, the wrong thing, or not in the struct it is given.

Each function gives the places of a source, without its comments, that a fault changes together.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

_Change = tuple[int, int, str]

_FUNCTION = re.compile(r"^[^\n#/{} ][^\n#/{}]*\([^;{}]*\)\n\{\n(.*?)^\}", re.DOTALL | re.MULTILINE)
_STORE = re.compile(r"(?<=\n) +((?:s->|y->|jac->|p->|v\[|\*status|status |result ).*?;)", re.DOTALL)
_HELD = re.compile(r"s->(\w+)_held((?:\[\w+\])?) = ([^;]*);")
_MEMBER = re.compile(r"\bs->(\w+)")
_LOCAL = re.compile(
    r"(?<=\n)( +)((?:\w+_real|uint32_t|bool) )(\w+)((?:\[\d+\])?)( = [^;]*)?;", re.DOTALL
)


def deleted(code: str) -> Iterator[tuple[_Change, ...]]:
    """A store to the state, an output, a derivative, a vector or the status is removed."""
    for body in _FUNCTION.finditer(code):
        for match in _STORE.finditer(body[1]):
            if "=" in match[1]:
                yield ((body.start(1) + match.start(1), body.start(1) + match.end(1), ";"),)


def raw_samples(code: str) -> Iterator[tuple[_Change, ...]]:
    """`hold` stores the sample as received instead of the valid one."""
    for match in _HELD.finditer(code):
        raw = f"u->{match[1]}{match[2]}"
        if match[3].startswith(match[1]):
            yield ((match.start(3), match.end(3), raw),)


def shared_memory(code: str) -> Iterator[tuple[_Change, ...]]:
    """A member of the state becomes a static object, which all instances share."""
    first = _FUNCTION.search(code)
    if first is None:
        return
    for field in sorted({match[1] for match in _MEMBER.finditer(code)}):
        uses = [match for match in _MEMBER.finditer(code) if match[1] == field]
        # an object as large as the state holds any field of it
        prefix = re.search(r"(\w+)_state_t \*s", code)
        assert prefix is not None
        definition = f"static {prefix[1]}_state_t shared_{field};\n"
        shared = [(m.start(), m.end(), f"shared_{field}.{field}") for m in uses]
        yield (*shared, (first.start(), first.start(), definition))


def static_locals(code: str) -> Iterator[tuple[_Change, ...]]:
    """A local variable becomes static, so that it keeps its value between calls."""
    for body in _FUNCTION.finditer(code):
        for match in _LOCAL.finditer(body[1]):
            indent, type, name, size, value = match.groups()
            at = body.start(1) + match.start(), body.start(1) + match.end()
            plain = value is None or re.fullmatch(r" = [\d.]+[fU]?", value)
            rest = value or "" if plain else f";\n{indent}{name}{value}"
            yield ((*at, f"{indent}static {type}{name}{size}{rest};"),)

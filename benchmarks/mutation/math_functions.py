"""Splits a generated C source of mathematical functions into its functions."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass

_FUNCTION = re.compile(
    r"^(?:static )?(?P<result>\w+) (?P<name>\w+)\((?P<given>[^;{}]*?)\)\n\{\n.*?^\}\n",
    re.DOTALL | re.MULTILINE,
)
PREFIX = "own"
_MIRRORED = re.compile(
    r"fabsf\(x\)|result = x;|\(x - x\) / \(x - x\);|x - x;|\(x < 0\.0f\) \? \(-(\w+)\) : \1;"
    r"|= x \* x;|result = x \+ \(x \* "
)
"""What reads an argument so that the result of -x is that of x, or its negative.

Infinities and NaN alone are subtracted from themselves. Of `x + (x * …)` the rest has no x.
"""


@dataclass(frozen=True, slots=True)
class Function:
    """A C function; `own` replaces the model's name in its text."""

    name: str
    text: str
    result: str
    given: tuple[str, ...]
    """The declarations of its parameters."""

    @property
    def is_public(self) -> bool:
        """True if code of a model calls the function."""
        return not self.text.startswith("static ")

    @property
    def arguments(self) -> tuple[str, ...]:
        """The names of the arguments that the function reads."""
        return tuple(one for one in self.given if "*" not in one)

    @property
    def written(self) -> tuple[str, ...]:
        """The names of the arguments that point to results."""
        return tuple(one for one in self.given if "*" in one)

    @property
    def is_mirrored(self) -> bool:
        """True if the text shows a function of one number to be even or odd, apart from zeros."""
        if self.arguments != ("float x",) or self.result == "void":
            return False
        body = self.text.partition("{")[2]
        return re.search(r"\bx\b", _MIRRORED.sub("", body)) is None

    def calls(self, name: str) -> bool:
        """True if the text of the function calls `name`."""
        return self.name != name and re.search(rf"\b{name}\(", self.text) is not None


def functions_of(source: str, prefix: str = PREFIX) -> dict[str, Function]:
    """All functions of a source by name, called ones before their callers."""
    own = re.sub(rf"\b{prefix}_", f"{PREFIX}_", source)
    return {
        match["name"]: Function(
            match["name"], match[0], match["result"], tuple(match["given"].split(", "))
        )
        for match in _FUNCTION.finditer(own)
    }


def needed(functions: Mapping[str, Function], name: str) -> dict[str, Function]:
    """A function and all functions that it calls, called ones first."""
    wanted = {name}
    for function in reversed([*functions.values()]):
        if any(functions[one].calls(function.name) for one in wanted):
            wanted.add(function.name)
    return {one: function for one, function in functions.items() if one in wanted}


def text_hash(right: Mapping[str, Function], changed: Mapping[str, Function]) -> str:
    """The hash of both texts, independent of line breaks and of callers."""
    texts = (
        "".join(one.text.removeprefix("static ") for one in of.values()) for of in (right, changed)
    )
    return hashlib.sha256("\n".join("".join(text.split()) for text in texts).encode()).hexdigest()

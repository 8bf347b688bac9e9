"""The functions of a generated C source of mathematical functions, by what they call."""

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
    """One of them, with `own` for the name of the model."""

    name: str
    text: str
    result: str
    given: tuple[str, ...]
    """The declarations of its parameters."""

    @property
    def is_public(self) -> bool:
        """Whether a model calls it."""
        return not self.text.startswith("static ")

    @property
    def arguments(self) -> tuple[str, ...]:
        """Those that are read."""
        return tuple(one for one in self.given if "*" not in one)

    @property
    def written(self) -> tuple[str, ...]:
        """Those that point to where a result goes."""
        return tuple(one for one in self.given if "*" in one)

    @property
    def is_mirrored(self) -> bool:
        """Whether a function of one number is even or odd by its text; zeros are left out."""
        if self.arguments != ("float x",) or self.result == "void":
            return False
        body = self.text.partition("{")[2]
        return re.search(r"\bx\b", _MIRRORED.sub("", body)) is None

    def calls(self, name: str) -> bool:
        """Whether its text does."""
        return self.name != name and re.search(rf"\b{name}\(", self.text) is not None


def functions_of(source: str, prefix: str = PREFIX) -> dict[str, Function]:
    """All of a source, callees first."""
    own = re.sub(rf"\b{prefix}_", f"{PREFIX}_", source)
    return {
        match["name"]: Function(
            match["name"], match[0], match["result"], tuple(match["given"].split(", "))
        )
        for match in _FUNCTION.finditer(own)
    }


def needed(functions: Mapping[str, Function], name: str) -> dict[str, Function]:
    """A function and all that it calls, callees first."""
    wanted = {name}
    for function in reversed([*functions.values()]):
        if any(functions[one].calls(function.name) for one in wanted):
            wanted.add(function.name)
    return {one: function for one, function in functions.items() if one in wanted}


def text_hash(right: Mapping[str, Function], changed: Mapping[str, Function]) -> str:
    """Of both texts, wherever their lines are broken, and whoever may call them."""
    texts = (
        "".join(one.text.removeprefix("static ") for one in of.values()) for of in (right, changed)
    )
    return hashlib.sha256("\n".join("".join(text.split()) for text in texts).encode()).hexdigest()

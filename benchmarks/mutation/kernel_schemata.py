"""Puts many changed functions into one kernel, of which a number chooses: one compilation for all.

Untch, Offutt, Harrold: Mutation analysis using mutant schemata, 1993. Each change is a copy of the
function in which it is; the function itself calls the copy that `msnn_mutant` says, or its own.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from benchmarks.mutation.mutants import Mutant

CHOICE = "msnn_mutant"
"""The int in the library: 0 for the right kernel, n for the n-th of the mutants."""

_FUNCTION = re.compile(
    r"^static (?:inline )?void (?P<name>\w+)\((?P<arguments>[^;{}]*?)\)\n\{\n.*?^\}\n",
    re.DOTALL | re.MULTILINE,
)


def with_all(model: str, changed: Sequence[Mutant]) -> str:
    """The functions of a model, and of each mutant the one that it changes."""
    copies: dict[str, list[tuple[int, str]]] = {}
    for number, mutant in enumerate(changed, start=1):
        name, text = _changed_function(model, mutant.text)
        copies.setdefault(name, []).append((number, text))

    def chosen(function: re.Match[str]) -> str:
        name = function["name"]
        own = [(0, function[0]), *copies.get(name, ())]
        cases = [_call(f"case {n}:", f"{name}_{n}", function["arguments"]) for n, _ in own[1:]]
        default = _call("default:", f"{name}_0", function["arguments"])
        texts = [_renamed(text, name, f"{name}_{n}") for n, text in own]
        header = function[0][: function[0].index("\n{\n")]
        body = "\n".join((*cases, default))
        return f"{''.join(texts)}{header}\n{{\n    switch ({CHOICE}) {{\n{body}\n    }}\n}}\n"

    return f"int {CHOICE} = 0;\n{_FUNCTION.sub(chosen, model)}"


def _changed_function(model: str, changed: str) -> tuple[str, str]:
    """The name of the function that differs, and its changed text."""
    for before, after in zip(_FUNCTION.finditer(model), _FUNCTION.finditer(changed), strict=True):
        if before[0] != after[0]:
            return before["name"], after[0]
    raise AssertionError("a mutant changes a function")


def _renamed(text: str, before: str, after: str) -> str:
    return text.replace(f"{before}(", f"{after}(", 1).replace("static inline", "static", 1)


def _call(label: str, name: str, arguments: str) -> str:
    given = ", ".join(part.split()[-1].lstrip("*") for part in arguments.split(","))
    return f"    {label} {name}({given}); return;"

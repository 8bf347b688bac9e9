"""Puts many changed functions into one program, in which a number chooses: one compilation for all.

Untch, Offutt, Harrold: Mutation analysis using mutant schemata, 1993. Each change is a copy of the
function in which it is; the function itself calls the copy that `msnn_mutant` says, or its own.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from benchmarks.mutation.mutants import Mutant

CHOICE = "msnn_mutant"
"""The int in the library: 0 for the right functions, n for the n-th of the mutants."""

_FUNCTION = re.compile(
    r"^(?P<head>(?:static )?(?:inline )?(?P<result>[\w ]+?) \*?(?P<name>\w+)\("
    r"(?P<arguments>[^;{}]*?)\))\n\{\n.*?^\}\n",
    re.DOTALL | re.MULTILINE,
)

_BY_ENVIRONMENT = f"""
#include <stdlib.h>
__attribute__((constructor)) static void choose_mutant(void)
{{
    const char *chosen = getenv("{CHOICE}");
    {CHOICE} = (chosen != NULL) ? atoi(chosen) : 0;
}}
"""


def with_all(model: str, changed: Sequence[Mutant]) -> str:
    """The functions of a model, and for each fault the changed function under a name of its own."""
    copies: dict[str, list[tuple[int, str]]] = {}
    for number, mutant in enumerate(changed, start=1):
        name, text = _changed_function(model, mutant.text)
        copies.setdefault(name, []).append((number, text))

    def chosen(function: re.Match[str]) -> str:
        name = function["name"]
        own = [(0, function[0]), *copies.get(name, ())]
        if len(own) == 1:
            return function[0]
        returns = function["result"] != "void"
        cases = [_call(f"case {n}:", f"{name}_{n}", function, returns) for n, _ in own[1:]]
        default = _call("default:", f"{name}_0", function, returns)
        texts = [_renamed(text, name, f"{name}_{n}") for n, text in own]
        body = "\n".join((*cases, default))
        head = function["head"]
        return f"{''.join(texts)}{head}\n{{\n    switch ({CHOICE}) {{\n{body}\n    }}\n}}\n"

    return f"int {CHOICE} = 0;\n{_FUNCTION.sub(chosen, model)}"


def program_with_all(source: str, changed: Sequence[Mutant]) -> str:
    """The same for a source file; the environment variable `msnn_mutant` selects the fault."""
    return with_all(source, changed) + _BY_ENVIRONMENT


def _changed_function(model: str, changed: str) -> tuple[str, str]:
    """The name of the function that differs, and its changed text."""
    for before, after in zip(_FUNCTION.finditer(model), _FUNCTION.finditer(changed), strict=True):
        if before[0] != after[0]:
            return before["name"], after[0]
    raise AssertionError("a mutant changes a function")


def _renamed(text: str, before: str, after: str) -> str:
    own = text.replace(f"{before}(", f"{after}(", 1).replace("static inline", "static", 1)
    return own if own.startswith("static") else f"static {own}"


def _call(label: str, name: str, function: re.Match[str], returns: bool) -> str:
    given = ", ".join(part.split()[-1].lstrip("*") for part in function["arguments"].split(","))
    called = f"return {name}({given});" if returns else f"{name}({given}); return;"
    return f"    {label} {called}"

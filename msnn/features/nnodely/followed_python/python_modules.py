"""Provides the predefined names of an interpreted function: modules, numbers, words."""

from __future__ import annotations

import ast
from dataclasses import dataclass

from msnn.features.nnodely.followed_python.torch_names import NUMBERS
from msnn.features.nnodely.terms.arrays import NotTranslatedError

MODULES = frozenset({"torch", "math"})
"""Modules with translated functions; functions of a file may use them without import."""

LOWERED = {"true": True, "false": False, "null": None}
"""Words that nnodely converts to lower case when it saves source code."""


@dataclass(frozen=True, slots=True)
class Module:
    """A name with members: `torch`, `torch.nn.functional`."""

    path: str

    def member(self, name: str) -> Module | float:
        """A number of torch, or what is called by this name."""
        # any other member is a path, judged where it is called: nothing is looked up in a real
        # module
        is_number = self.path in MODULES and name in NUMBERS
        return NUMBERS[name] if is_number else Module(f"{self.path}.{name}")


def imported(statement: ast.Import | ast.ImportFrom) -> dict[str, Module | float]:
    """The names bound by an import statement. Raises NotTranslatedError for unsupported modules."""
    if isinstance(statement, ast.ImportFrom):
        module = _known("." * statement.level + (statement.module or ""))
        for one in statement.names:
            if one.name == "*":
                raise NotTranslatedError(f"an import of `{module.path}.*`")
        return {one.asname or one.name: module.member(one.name) for one in statement.names}
    found: dict[str, Module | float] = {}
    for one in statement.names:
        module = _known(one.name)
        first = one.name.partition(".")[0]
        # as Python: `import torch.nn` gives a name to `torch`, `import torch.nn as nn` to
        # `torch.nn`
        found[one.asname or first] = module if one.asname else Module(first)
    return found


def _known(path: str) -> Module:
    if path.partition(".")[0] in MODULES:
        return Module(path)
    raise NotTranslatedError(f"an import of `{path}`")

"""A docstring begins with a noun or a verb; only that of a truth with `Whether`."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

from tests.test_class_names import PACKAGES, ROOT

# relative clauses and cases without a noun: what they are of stands nowhere in the sentence
_WITHOUT_A_NOUN = frozenset(
    ["How", "Of", "That", "These", "Those", "What", "When", "Where", "Which", "Who", "Why"]
)
_OF_A_TRUTH = re.compile(r"bool|BoolArray|Truth|TypeGuard\[.*\]")


def test_a_docstring_begins_with_a_noun_or_a_verb() -> None:
    found: list[str] = []
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            tree = ast.parse(path.read_text(encoding="utf-8"))
            found += [f"{path.relative_to(ROOT)}:{place}" for place in _without_a_noun(tree)]
    assert not found, (
        "name the thing or say what it does (CONTRIBUTING.md, How the code reads, 6):\n"
        + "\n".join(found)
    )


def _without_a_noun(tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        if not isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        first = (ast.get_docstring(node) or "").split(maxsplit=1)[:1]
        if first and (first[0] in _WITHOUT_A_NOUN or (first[0] == "Whether" and not _tells(node))):
            line = 1 if isinstance(node, ast.Module) else node.lineno
            yield f"{line}: {' '.join((ast.get_docstring(node) or '').split()[:6])} …"


def _tells(node: ast.AST) -> bool:
    """Whether the node is a function of a truth, or of an array of truths."""
    return (
        isinstance(node, ast.FunctionDef)
        and node.returns is not None
        and _OF_A_TRUTH.fullmatch(ast.unparse(node.returns)) is not None
    )

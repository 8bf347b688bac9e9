"""Every diagnostic, from the constructors that write them."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from tests.docs.markdown import apart, paragraph, table
from tests.message_files import message_files

_EXAMPLES = Path(__file__).parents[1] / "bad_specs"
_CODE = re.compile(r"[EW]\d{4}")


@dataclass(frozen=True)
class Message:
    """A code and what its constructor says it means."""

    code: str
    meaning: str


def diagnostics() -> str:
    """One table a file of constructors, in the order of their codes."""
    groups = [
        (paragraph(ast.get_docstring(tree)), found)
        for path in message_files()
        for tree in [ast.parse(path.read_text(encoding="utf-8"))]
        if (found := sorted(_messages(tree), key=_number))
    ]
    groups.sort(key=lambda group: _number(group[1][0]))
    parts: list[str] = []
    for about, found in groups:
        _, _, topic = about.partition(": ")
        parts.append(f"## {topic[:1].upper()}{topic[1:].rstrip('.')}")
        rows = [(_explained(m.code), m.meaning, _example(m.code)) for m in found]
        parts.append(table(("code", "what is wrong", "example"), rows))
    return apart(*parts)


def all_messages() -> Iterator[Message]:
    """Every code of every constructor."""
    for path in message_files():
        yield from _messages(ast.parse(path.read_text(encoding="utf-8")))


def _messages(tree: ast.Module) -> Iterator[Message]:
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            codes, _, meaning = paragraph(ast.get_docstring(node)).partition(": ")
            for code in _CODE.findall(codes):
                yield Message(code, meaning.rstrip("."))


def _number(message: Message) -> tuple[str, str]:
    return message.code[1:], message.code


def _explained(code: str) -> str:
    return f"[{code}](../spec_schema/explanations/{code}.md)"


def _example(code: str) -> str:
    found = sorted(_EXAMPLES.glob(f"{code}_*.txt"))
    return f"[{found[0].stem}](../tests/bad_specs/{found[0].name})" if found else ""

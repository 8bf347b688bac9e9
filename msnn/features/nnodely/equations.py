"""Writes terms as texts of a spec; repeated or long parts become equations."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from msnn.features.nnodely.terms.names import TakenNames
from msnn.features.nnodely.terms.terms import ATOM, Call, Infix, Term, after_operands, text_of

_LONGEST = 120
"""Maximum characters of a text within another one."""
_LONGEST_ENTRY = 3000
"""Maximum characters of an entry, below the limit of the parser."""
_LONGEST_NAME = 8
"""Minimum characters of an operand that is worth an equation."""


@dataclass(slots=True, kw_only=True)
class Equations:
    """The texts of terms, and their common equations."""

    names: TakenNames
    hints: Mapping[int, str]
    """Names of terms, by identity."""
    texts: dict[str, str] = field(default_factory=dict[str, str])
    _written: dict[int, tuple[str, int]] = field(default_factory=dict[int, "tuple[str, int]"])
    _uses: dict[int, int] = field(default_factory=dict[int, int])

    def count(self, roots: Iterable[Term]) -> None:
        """Registers a term to be written, to count repeated parts."""
        seen: set[int] = set()
        for root in roots:
            self._uses[id(root)] = self._uses.get(id(root), 0) + 1
            for node in after_operands(root, lambda one: id(one) in seen):
                seen.add(id(node))
                for arg in node.args:
                    self._uses[id(arg)] = self._uses.get(id(arg), 0) + 1

    def name(self, term: Term, name: str) -> None:
        """Registers a term as an entry of the spec, so that others refer to its name."""
        if term.args and id(term) not in self._written:
            self._written[id(term)] = (name, ATOM)

    def is_named(self, term: Term, name: str) -> bool:
        """True if others refer to this term by that name."""
        return self._written.get(id(term), ("", 0))[0] == name

    def text(self, root: Term, *, entry: str | None = None) -> str:
        """The text of a term; for the entry with its name, the formula."""
        for arg in root.args:
            for node in after_operands(arg, lambda one: id(one) in self._written):
                self._written[id(node)] = self._shared(node)
        text = self._text_of(root)
        if entry is not None:
            return text[0]
        if id(root) not in self._written:
            self._written[id(root)] = self._shared(root)
        return self._written[id(root)][0]

    def _shared(self, node: Term) -> tuple[str, int]:
        text = self._text_of(node)
        # a comparison is no value in the language: it may stand in a `where` alone
        is_condition = isinstance(node.head, Infix) and node.head.sign[0] in "<>"
        used_often = self._uses.get(id(node), 1) > 1 and len(text[0]) > 12
        if not node.args or is_condition or not (used_often or len(text[0]) > _LONGEST):
            return text
        # a concatenation has no dimension of its own, which an equation would need
        if isinstance(node.head, Call) and node.head.name == "concat":
            return text
        return self._named(node, text[0])

    def _text_of(self, node: Term) -> tuple[str, int]:
        """The text of a term, with equations for operands if there are too many."""
        text = text_of(node, [self._written[id(arg)] for arg in node.args])
        if len(text[0]) <= _LONGEST_ENTRY:
            return text
        for arg in node.args:
            inner = self._written[id(arg)][0]
            if arg.args and len(inner) > _LONGEST_NAME:
                # told by identity: equal terms of two places may have other names
                self._written[id(arg)] = self._named(arg, inner)
        return text_of(node, [self._written[id(arg)] for arg in node.args])

    def _named(self, node: Term, text: str) -> tuple[str, int]:
        name = self.names.free(self.hints.get(id(node), "e"))
        self.texts[name] = text
        return name, ATOM

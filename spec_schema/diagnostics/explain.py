"""Explains diagnostic codes and their repair from the pages in `explanations/`."""

import re
import textwrap
from dataclasses import dataclass
from functools import cache
from pathlib import Path

FOLDER = Path(__file__).parents[1] / "explanations"
_WIDTH = 88
# the words behind the language are for this pattern: Markdown shows none of them
_FENCED = re.compile(r"^```(\w+) (wrong|repaired)( whole)?\n(.*?)^```$", re.DOTALL | re.MULTILINE)
_TITLES = {"wrong": "Wrong:", "repaired": "Repaired:"}


@dataclass(frozen=True)
class Example:
    """A code block of an explanation: a spec or data that is `wrong` or `repaired`.

    A block of a spec shows only the relevant part; a `whole` one is a complete file.
    """

    language: str
    repaired: bool
    whole: bool
    text: str


@dataclass(frozen=True)
class Explanation:
    """One code: its meaning in a line, and the page as Markdown."""

    code: str
    meaning: str
    page: str

    @property
    def examples(self) -> tuple[Example, ...]:
        """The code blocks of the explanation, in its order."""
        return tuple(
            Example(found[1], found[2] == "repaired", bool(found[3]), found[4])
            for found in _FENCED.finditer(self.page)
        )

    @property
    def text(self) -> str:
        """The page for a terminal: examples indented, all else in lines of readable length."""
        title, _, rest = self.page.partition("\n")
        # the title is set apart: as a paragraph it would be wrapped
        parts = [title.removeprefix("# ")]
        end = 0
        for found in _FENCED.finditer(rest):
            parts += _paragraphs(rest[end : found.start()])
            parts += [_TITLES[found[2]], textwrap.indent(found[4].rstrip("\n"), "    ")]
            end = found.end()
        return "\n\n".join([*parts, *_paragraphs(rest[end:])])


@cache
def known_codes() -> tuple[str, ...]:
    """All codes, ordered by number."""
    return tuple(sorted((path.stem for path in FOLDER.glob("*.md")), key=_number))


def explain(code: str) -> Explanation:
    """The explanation of a code in upper or lower case; KeyError for an unknown one."""
    wanted = code.strip().upper()
    if wanted not in known_codes():
        raise KeyError(wanted)
    page = (FOLDER / f"{wanted}.md").read_text(encoding="utf-8")
    _, _, meaning = page.partition("\n")[0].partition(": ")
    return Explanation(wanted, meaning, page)


def _number(code: str) -> tuple[str, str]:
    # by number, so that W0504 stands behind E0503 and not behind all errors
    return code[1:], code


def _paragraphs(text: str) -> list[str]:
    parts = (part.replace("**", "") for part in text.strip().split("\n\n"))
    return [textwrap.fill(part, _WIDTH) for part in parts if part]

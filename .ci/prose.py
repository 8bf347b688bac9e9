"""Checks new prose for words and sentences that readers from outside stumble over.

    python .ci/prose.py             one line per finding; exit code 1 if there is one
    python .ci/prose.py --shrink    removes sentences from the list that no longer occur

It reads pages, docstrings and messages. Older sentences are listed in `prose_known.txt` by the
first digits of their hash, so that they may move. The list shrinks: whoever edits such a sentence
rewrites it. An exception that is meant, such as a quotation, gets a line there too.
"""

import hashlib
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
KNOWN = Path(__file__).with_name("prose_known.txt")
PAGES = (
    "*.md",
    "docs/**/*.md",
    "examples/*/README.md",
    "spec_schema/explanations/*.md",
    "**/decisions.md",
)
CODE = ("spec_schema", "compiler", "backends", "msnn")
LEFT_OUT = {"CHANGELOG.md", "docs/keys.md", "docs/cli.md", "docs/errors.md", "docs/names.md"}
"""The changelog tells of the past; the other pages are generated from docstrings and messages."""

LONGEST = 30
"""Words of a sentence. Aim at 25: names, numbers and code are counted as words here."""

WORDS = (
    (r"slopes?", "derivative, gradient or Jacobian"),
    (r"judge[ds]?", "reference interpreter, evaluate, check"),
    (r"(?:is|are|was|were) (?:told|said)", "is reported, or name who reports it"),
    (r"tells? of", "reports, describes"),
    (r"in place of", "instead of"),
    (r"alike|anew", "identically, again"),
    (r"all the same", "anyway"),
    (r"stands? (?:for|in)", "means, is in"),
    (r"without a word", "silently"),
    (r"its doubts?", "standard error, uncertainty"),
    (r"most telling", "most informative"),
    (r"an? (?:sample|step|epoch|row|record) an? (?:sample|step|epoch|row|record)", "one per"),
    (r"free runs?", "simulation"),
    (r"what is (?:meant|wanted|measured|missing|left)", "name the thing"),
)
"""Patterns and what to write instead."""

_WORDS = [(re.compile(rf"\b(?:{pattern})\b", re.IGNORECASE), use) for pattern, use in WORDS]
_CLAUSE = re.compile(r"(?:What|Which|Whether|That which|Of the|Of a|Who|Where it)\b")
_HIDDEN = re.compile(r"^(?:```|~~~).*?^(?:```|~~~)|<!--.*?-->|^\|.*$", re.MULTILINE | re.DOTALL)
_CODE = re.compile(r"`[^`\n]*`|\]\([^)\n]*\)|<[^>\n]*>")
_SENTENCE = re.compile(r"[^.!?:]+(?:[.!?:](?!\s|$)[^.!?:]*)*[.!?:]?")
_DOCSTRING = re.compile(r'^[ \t]*r?"""(.*?)"""', re.MULTILINE | re.DOTALL)
_TEXT = re.compile(r'f?"((?:[^"\\\n]|\\.)*)"')


@dataclass(frozen=True)
class Finding:
    """A sentence, its place, and what is wrong with it."""

    path: str
    line: int
    sentence: str
    fault: str

    @property
    def key(self) -> str:
        """The name of the sentence in the list of known ones."""
        return hashlib.sha256(self.sentence.encode()).hexdigest()[:10]


def faults(sentence: str, *, whole: bool = True) -> Iterator[str]:
    """The faults of a sentence; of a part of one (`whole` is False) its words alone."""
    for pattern, use in _WORDS:
        found = pattern.search(sentence)
        if found:
            yield f"`{found[0]}`: write {use}"
    if whole and not sentence.endswith("?") and _CLAUSE.match(sentence):
        yield f"starts with `{sentence.split()[0]}`: start with the name of a thing"
    words = len(re.findall(r"\w[\w'-]*", sentence))
    if whole and words > LONGEST:
        yield f"{words} words: make two sentences"


def findings(path: str, text: str) -> Iterator[Finding]:
    """All findings of a page or a module; `path` says which of them it is."""
    if path.endswith(".md"):
        yield from _of_prose(path, _HIDDEN.sub(_blank, text), 1)
        return
    for found in _DOCSTRING.finditer(text):
        yield from _of_prose(path, found[1], text.count("\n", 0, found.start(1)) + 1)
    if "/errors/" in path:
        rest = _DOCSTRING.sub(_blank, text)
        for found in _TEXT.finditer(rest):
            line = rest.count("\n", 0, found.start()) + 1
            sentence = " ".join(_CODE.sub("X", found[1]).split())
            for fault in faults(sentence, whole=False):
                yield Finding(path, line, sentence, fault)


def _of_prose(path: str, text: str, first: int) -> Iterator[Finding]:
    """Sentences of paragraphs and items; a heading, an item and a paragraph end one."""
    for block in re.finditer(r"(?:^(?!\s*$).*\n?)+", text, re.MULTILINE):
        for part in re.split(r"(?m)^(?=\s*(?:[-*+]|\d+\.|#+) )", block[0]):
            plain = " ".join(_CODE.sub("X", part).split()).lstrip("-*+#0123456789. ")
            plain = plain.replace("**", "").replace("[", "")
            is_heading = part.lstrip().startswith("#")
            line = first + text.count("\n", 0, block.start() + block[0].index(part))
            for each in _SENTENCE.finditer(plain):
                sentence = each[0].strip()
                for fault in faults(sentence, whole=not is_heading):
                    yield Finding(path, line, sentence, fault)


def _blank(found: re.Match[str]) -> str:
    return "\n" * found[0].count("\n")


def files() -> Iterator[Path]:
    """Everything that is checked."""
    for pattern in PAGES:
        pages = ROOT.glob(pattern)
        yield from (page for page in pages if str(page.relative_to(ROOT)) not in LEFT_OUT)
    for folder in CODE:
        yield from (ROOT / folder).rglob("*.py")


def main() -> int:
    known = set(KNOWN.read_text(encoding="utf-8").split())
    found = [
        finding
        for path in sorted(set(files()))
        for finding in findings(path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8"))
    ]
    if "--shrink" in sys.argv[1:]:
        kept = sorted(known & {finding.key for finding in found})
        KNOWN.write_text("".join(f"{key}\n" for key in kept), encoding="utf-8")
        print(f"{len(known) - len(kept)} sentences removed, {len(kept)} left")
        return 0
    new = [finding for finding in found if finding.key not in known]
    for each in new:
        print(f"{each.path}:{each.line}: {each.fault}\n    {each.sentence}  [{each.key}]")
    if new:
        print(f"{len(new)} findings; an exception gets its [key] as a line of {KNOWN.name}")
    return 1 if new else 0


if __name__ == "__main__":
    sys.exit(main())

"""Scans an expression before Python parses it: characters, brackets, words, durations."""

import re
from collections.abc import Mapping

from spec_schema.diagnostics.diagnostic import Diagnostic, Findings
from spec_schema.diagnostics.source import Span
from spec_schema.errors import expressions as errors
from spec_schema.expressions.tree import Duration, Length, Samples
from spec_schema.late_dataclass import dataclass
from spec_schema.names import is_name, is_python_word, normalised
from spec_schema.units.quantity import Quantity
from spec_schema.units.unit import unit_symbol
from spec_schema.yaml_tree.nodes import Positions

NUMBER_PATTERN = r"(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
# `3 min(a, b)` is a missing operator before a function, not three minutes.
DURATION = re.compile(
    rf"(?P<number>{NUMBER_PATTERN})[ \t]*(?P<unit>us|ms|s|min|h)(?!\w)(?![ \t]*[(])"
)
_LENGTH = re.compile(r"(?P<samples>[0-9]{1,9})")


def parse_length(text: str, positions: Positions) -> Length | None:
    """A length as a number of samples or a duration such as `50 ms`; None for other texts."""
    span = positions.span(0, len(text))
    samples = _LENGTH.fullmatch(text)
    if samples is not None:
        return Samples(int(text), span)
    found = DURATION.fullmatch(text)
    return None if found is None else duration_of(found, positions, span_start=0)


def duration_of(found: re.Match[str], positions: Positions, span_start: int) -> Duration | None:
    """The duration that a match of DURATION writes; None if its number is too large for a float."""
    value = float(found["number"])
    unit = unit_symbol(found["unit"])
    assert unit is not None
    # larger ones are infinite, or become so in another unit
    if value > _LONGEST_NUMBER:
        return None
    span = positions.span(span_start, span_start + len(found.group()))
    return Duration(Quantity(value, unit, span), span)


_LONGEST_NUMBER = 1e300


DEEPEST = 100
# Random bytes would else bring a message for nearly each of them.
_MOST_FAULTS = 8

_TOKEN = re.compile(
    # one pass, longest tokens first: `**` before `*`, a duration before its number
    rf"(?P<blank>\s+|\#[^\n]*)|(?P<duration>{DURATION.pattern})|(?P<literal>{NUMBER_PATTERN})"
    r"|(?P<word>\w+)|(?P<text>'[^'\n]*'?|\"[^\"\n]*\"?)|(?P<caret>\^)|(?P<equality>==|!=)"
    r"|(?P<foreign>//|<<|>>|->|:=|&&?|\|\|?|[%~])"
    r"|(?P<operator>\*\*|<=|>=|[-+*/@<>.,=:])|(?P<open>[(\[])|(?P<close>[)\]])"
)
_LEADING_ZEROS = re.compile(r"0[0-9]+")
_WHOLE = re.compile(r"(?<![\w.])\d+,$")
_DIGITS = "0123456789."
_PARTNER = {")": "(", "]": "["}
_BOOLEAN_WORDS = {"and", "or", "not"}
_MEANT = {
    "·": "*",
    "×": "*",
    "÷": "/",
    "−": "-",
    "–": "-",
    "≤": "<=",
    "≥": ">=",
    "²": "**2",
    "³": "**3",
}
"""Replacements of characters from printed mathematics."""
_REPAIRS = {
    **{character: f"write `{meant}`" for character, meant in _MEANT.items()},
    "−": "write `-`, the minus sign of the keyboard",
    "–": "write `-`, the minus sign of the keyboard",
    "{": "use ( ) to group and [ ] for lists and windows",
    "}": "use ( ) to group and [ ] for lists and windows",
    ";": "one expression a key; list elements are separated by `,`",
    "“": 'write a straight quote, `"`',
    "”": 'write a straight quote, `"`',
    "„": 'write a straight quote, `"`',
    "‘": "write a straight quote, `'`",
    "’": "write a straight quote, `'`",
    "«": 'write a straight quote, `"`',
    "»": 'write a straight quote, `"`',
    "√": "write `sqrt( )`",
    "!": "there is no logic on numbers; nest `where`",
    "?": "a choice is `where(condition, then, otherwise)`",
}


@dataclass(frozen=True)
class ScannedExpression:
    """The text of an expression, changed so that Python's parser can read it, with the same length.

    Comments and unusual white space are blanks. Each duration is replaced by a word of underscores;
    `durations` maps its offset to the duration.
    """

    text: str
    durations: Mapping[int, Duration]


def scan_expression(text: str, positions: Positions, findings: Findings) -> ScannedExpression:
    """Prepares an expression for Python's parser, and reports errors that it would explain badly or
    accept.
    """
    return _Scanner(text, positions, findings).run()


class _Scanner:
    def __init__(self, text: str, positions: Positions, findings: Findings) -> None:
        self.text = text
        self.positions = positions
        self.findings = findings
        self.faults = 0
        self.clean: list[str] = []
        self.durations: dict[int, Duration] = {}
        self.open: list[tuple[str, int]] = []
        # The last operand, when the token before was the end of one.
        self.operand: tuple[int, int] | None = None

    def run(self) -> ScannedExpression:
        position = 0
        while position < len(self.text) and self.faults < _MOST_FAULTS:
            found = _TOKEN.match(self.text, position)
            if found is None:
                self._foreign_character(position)
                self.clean.append(" ")
                position += 1
                continue
            self._token(found)
            position = found.end()
        if self.faults >= _MOST_FAULTS:
            # The rest was not looked at: what seems open may be closed there.
            self.open.clear()
        for bracket, start in self.open:
            self._report(errors.unbalanced_bracket(bracket, self._span(start, start + 1), False))
        return ScannedExpression("".join(self.clean), self.durations)

    def _token(self, found: re.Match[str]) -> None:
        text, start, end = found.group(), found.start(), found.end()
        clean = text
        is_operand = False
        match found.lastgroup:
            case "blank":
                # line breaks stay: positions of Python's parser count lines
                self.clean.append("".join("\n" if c == "\n" else " " for c in text))
                return
            case "duration":
                is_operand = True
                duration = duration_of(found, self.positions, start)
                if duration is None:
                    self._report(errors.huge_number(text, self._span(start, end)))
                else:
                    self.durations[start] = duration
                # as long as the duration, so that offsets stay, and no name that anybody declares
                clean = "_" * len(text)
            case "literal":
                is_operand = True
                whole = None if self.open else _WHOLE.search(self.text[:start])
                if _LEADING_ZEROS.fullmatch(text) and whole:
                    # `2,05` and `2,000`: zeros behind a comma are no octal number
                    span = self._span(whole.start(), end)
                    self._report(errors.several_values(span, whole.group() + text))
                elif _LEADING_ZEROS.fullmatch(text):
                    self._report(errors.malformed_number(text, self._span(start, end)))
            case "word":
                is_operand = self._word(text, start)
            case "text":
                self._report(errors.text_in_expression(self._span(start, end)))
            case "caret":
                self._report(errors.caret(self._span(start, end)))
            case "equality":
                self._report(errors.equality(text, self._span(start, end)))
            case "foreign":
                self._report(errors.foreign_operator(text, self._span(start, end)))
            case "operator" if text == "=" and not self.open:
                self._report(errors.assignment(self._span(start, end)))
            case "open":
                self._open(text, start)
            case "close":
                self._close(text, start)
            case _:
                pass
        self.clean.append(clean)
        if is_operand and self.operand is not None:
            first, last = self.operand
            left = self.text[first:last]
            # `5 m` may be a quantity without quotes: the message says so
            is_unit = left[0] in _DIGITS and unit_symbol(text) is not None
            self._report(errors.missing_operator(left, text, self._span(first, end), is_unit))
        # a closing bracket ends an operand too: `(a) b`
        self.operand = (start, end) if is_operand or found.lastgroup == "close" else None

    def _word(self, word: str, start: int) -> bool:
        """Checks a word and reports errors; True if it is an operand."""
        name, end = normalised(word), start + len(word)
        if name in _BOOLEAN_WORDS:
            self._report(errors.boolean_word(name, self._span(start, end)))
        elif is_python_word(name):
            self._report(errors.python_word(name, self._span(start, end)))
        else:
            if not is_name(word):
                self._report(errors.malformed_word(word, self._span(start, end)))
            return True
        return False

    def _open(self, bracket: str, start: int) -> None:
        # `2 (x)` is a product without its sign, `f(x)` a call
        # only of numbers it is sure: `gain (x)` may be a call of a function that is not declared
        literal = self.operand is not None and self.text[self.operand[0]] in _DIGITS
        if literal and self.operand is not None:
            first, last = self.operand
            span = self._span(first, start + 1)
            self._report(errors.missing_operator(self.text[first:last], bracket, span))
        self.open.append((bracket, start))
        if len(self.open) > DEEPEST:
            self._report(errors.too_deep(DEEPEST, self._span(0, len(self.text))))
            # deeper brackets are not looked at: the whole is refused
            self.faults = _MOST_FAULTS

    def _close(self, bracket: str, start: int) -> None:
        if self.open and self.open[-1][0] == _PARTNER[bracket]:
            self.open.pop()
        else:
            self._report(errors.unbalanced_bracket(bracket, self._span(start, start + 1), True))

    def _foreign_character(self, position: int) -> None:
        character = self.text[position]
        span = self._span(position, position + 1)
        meant, repair = _MEANT.get(character), _REPAIRS.get(character)
        self._report(errors.foreign_character(character, span, meant, repair))
        self.operand = None

    def _span(self, first: int, last: int) -> Span:
        return self.positions.span(first, last)

    def _report(self, diagnostic: Diagnostic) -> None:
        self.findings.report(diagnostic)
        self.faults += 1

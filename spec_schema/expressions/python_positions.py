"""Converts positions of Python's parser (UTF-8 columns in an added parenthesis) to spans."""

import ast
from itertools import accumulate

from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import Span
from spec_schema.errors import expressions as errors
from spec_schema.yaml_tree.nodes import Positions


class PythonPositions:
    """Places of the nodes that `ast.parse("(" + text + "\\n)")` returns, as spans of the file."""

    def __init__(self, text: str, positions: Positions) -> None:
        self._text = text
        self._positions = positions
        # A tuple without brackets ends behind the added parenthesis, on a line of its own.
        self._lines = [*text.split("\n"), ""]
        lengths = (len(line) + 1 for line in self._lines)
        self._starts = [0, *accumulate(lengths)]
        self._texts: dict[Span, str] = {}

    def of(self, node: ast.expr | ast.keyword | ast.Slice) -> Span:
        """The span of a node."""
        first, last = self.start(node), self.end(node)
        span = self._positions.span(first, last)
        self._texts[span] = self._text[first:last]
        return span

    def text_of(self, span: Span) -> str:
        """The text of a span that `of` returned."""
        return self._texts[span]

    def between(self, left: ast.expr, right: ast.expr, operator: str) -> Span:
        """The span of the operator that stands between two operands."""
        # between the operands there are blanks, parentheses and the operator
        start = self._text.index(operator, self.end(left), self.start(right))
        return self._positions.span(start, start + len(operator))

    def syntax_fault(self, error: SyntaxError) -> Diagnostic:
        """The diagnostic of Python's syntax error, in wording independent of its version."""
        line, column = error.lineno or 1, (error.offset or 1) - 1
        if line >= len(self._lines):
            # It stumbled over the added parenthesis.
            last = len(self._text.rstrip())
            return errors.incomplete_expression(self._positions.span(last - 1, last))
        # Python may point behind the fault: what is shown lies within the text in any case
        start = self._starts[line - 1] + column - (1 if line == 1 else 0)
        start = min(max(start, 0), len(self._text) - 1)
        return errors.malformed_expression(self._positions.span(start, start + 1))

    def start(self, node: ast.expr | ast.keyword | ast.Slice) -> int:
        """The offset in the text at which a node starts."""
        return self._offset(node.lineno, node.col_offset)

    def end(self, node: ast.expr | ast.keyword | ast.Slice) -> int:
        """The offset in the text at which a node ends."""
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        return self._offset(node.end_lineno, node.end_col_offset)

    def _offset(self, line: int, byte_column: int) -> int:
        added = 1 if line == 1 else 0
        line_text = self._lines[line - 1]
        # Python counts columns in bytes of UTF-8
        if not line_text.isascii():
            # of the bytes before it, as many characters as they decode to
            byte_column = len(line_text.encode()[: byte_column - added].decode()) + added
        offset = self._starts[line - 1] + byte_column - added
        return min(max(offset, 0), len(self._text))

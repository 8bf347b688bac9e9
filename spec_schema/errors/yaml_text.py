"""E01xx: the text of a file as YAML 1.2 or JSON, before anything is known of its meaning."""

from spec_schema.diagnostics.diagnostic import Diagnostic, error
from spec_schema.diagnostics.source import Span
from spec_schema.diagnostics.suggest import with_point_or_joined


def other_syntax(problem: str, span: Span) -> Diagnostic:
    """E0101: a fault of syntax without a better explanation."""
    return error("E0101", span, f"not valid YAML: {problem}", "cannot be read from here on")


def tab(span: Span) -> Diagnostic:
    """E0102: a tab where YAML wants blanks."""
    # the YAML standard forbids it (6.1): how far a tab indents is each editor's own
    return error("E0102", span, "YAML does not indent by tabs", "a tab", help="use blanks")


def bracket_in_flow(text: str, span: Span) -> Diagnostic:
    """E0103: an unquoted `x[t+1]` within { } or [ ]."""
    message = "an unquoted value within { } or [ ] cannot contain brackets"
    # the parser stopped within a call: where the value ends is anybody's guess
    is_whole = text.count("(") == text.count(")")
    meant = f'"{text}"' if is_whole else None
    repair = f"quote it: {meant}" if meant else "quote the whole expression"
    # quotes of a word processor: YAML reads them as letters
    if text.startswith(("“", "”", "„", "‘", "’", "«", "»")):
        repair, meant = 'write straight quotes, `"`, in place of these', None
    label = "YAML reads its own list here"
    return error("E0103", span, message, label, help=repair, replacement=meant)


def stray_alias(text: str, span: Span) -> Diagnostic:
    """E0104: an unquoted glob, or a reference to an anchor that is not there."""
    message = f"`{text}` is an alias of YAML, and nothing has that anchor"
    meant, label = f'"{text}"', "`*` starts an alias"
    return error("E0104", span, message, label, help=f"quote it: {meant}", replacement=meant)


def duplicate_key(key: str, span: Span, first: Span) -> Diagnostic:
    """E0105: a key twice in one mapping."""
    message = f"the key `{key}` is given twice"
    label = "again here"
    repair = "keep one of the two, or give one another name"
    return error("E0105", span, message, label, secondary=((first, "first here"),), help=repair)


def tagged(tag: str, span: Span) -> Diagnostic:
    """E0106: a YAML tag."""
    # a tag could make objects of Python: the reader refuses all of them
    message = f"the YAML tag `{tag}` is not used in specs"
    return error("E0106", span, message, "tag", help="remove it")


def merge_key(span: Span) -> Diagnostic:
    """E0107: a merge key."""
    # of YAML 1.1 only: 1.2 has no such key, and readers of JSON would not know it
    message = "merge keys (`<<`) are not used in specs"
    return error("E0107", span, message, "merge key", help="write the keys out")


def too_many_values(most: int, span: Span) -> Diagnostic:
    """E0108: a file that is too large, also after its aliases are expanded."""
    message = f"the file expands to more than {most:,} values"
    return error("E0108", span, message, "the limit is reached here")


def too_deep(deepest: int, span: Span) -> Diagnostic:
    """E0109: too deeply nested mappings and lists."""
    return error("E0109", span, f"nested deeper than {deepest} levels", "too deep")


def second_document(span: Span) -> Diagnostic:
    """E0110: several documents in a file."""
    return error("E0110", span, "a spec is one YAML document", "a second one starts here")


def empty_file(span: Span) -> Diagnostic:
    """E0111: nothing in the file."""
    return error("E0111", span, "the file is empty", "no spec here", help="start with `msnn: 1`")


def key_is_not_text(found: str, span: Span) -> Diagnostic:
    """E0112: a key that is a list, a mapping, empty, or has invisible characters."""
    return error("E0112", span, f"a key is one line of text, this is {found}", "not a key")


def not_utf8(span: Span) -> Diagnostic:
    """E0113: bytes that are not UTF-8."""
    message = "the file is not UTF-8"
    return error("E0113", span, message, "a byte that is not UTF-8", help="save it as UTF-8")


def control_character(code_point: int, span: Span) -> Diagnostic:
    """E0114: an invisible control character."""
    message = f"the control character U+{code_point:04X} stands in the file"
    return error("E0114", span, message, "here", help="remove it", replacement="")


def own_alias(name: str, span: Span) -> Diagnostic:
    """E0115: an alias inside the value that it refers to."""
    return error("E0115", span, f"`*{name}` stands for what contains it", "without end")


def second_colon(span: Span) -> Diagnostic:
    """E0116: `a: b: c`."""
    message = "a value cannot contain `: ` unless it is quoted"
    repair = "quote the value; keys and values on one line stand in braces: `{key: value}`"
    return error("E0116", span, message, "a second `:` in this line", help=repair)


def no_blank_after_colon(key: str, value: str, span: Span) -> Diagnostic:
    """E0129: `c:{init: 1}`, which is one word to YAML."""
    message = f"YAML reads `{key}:{value}` as one word: a colon ends a key only before a blank"
    repair, label = f"write `{key}: {value}`", "no blank after the colon"
    return error("E0129", span, message, label, help=repair, replacement=": ")


def decimal_comma(text: str, span: Span) -> Diagnostic:
    """E0130: `2,5` for a number."""
    message = f"`{text}` is two values: numbers have a decimal point"
    # YAML 1.2 reads a text here, which a message about numbers would not explain
    meant, *others = with_point_or_joined(text)
    repair = f"write `{meant}`"
    if not others:
        return error("E0130", span, message, "a comma", help=repair, replacement=meant)
    # 1,200 is twelve hundred to some, and a number must not change by a thousand without a word
    repair += f" where the comma parts thousands, `{others[0]}` where it is a decimal point"
    return error("E0130", span, message, "a comma", help=repair)


def odd_blank(code_point: int, span: Span) -> Diagnostic:
    """E0131: a character that looks like a blank but is another one, as on web pages."""
    message = f"the character U+{code_point:04X} looks like a blank and is none"
    repair = "type an ordinary blank in its place"
    return error("E0131", span, message, "here", help=repair, replacement=" ")


def comma_splits(text: str, span: Span) -> Diagnostic:
    """E0117: an unquoted call with several arguments within { } or [ ]."""
    message = "a comma ends an unquoted value within { } or [ ]"
    repair = "quote the expression, or write it on a line of its own"
    return error("E0117", span, message, f"YAML reads only `{text}`", help=repair)


def key_without_value(key: str, span: Span) -> Diagnostic:
    """E0118: a lone word within { }."""
    message = f"`{key}` has no value"
    repair = "quote values that contain commas; a list stands in brackets, `[a, b]`"
    return error("E0118", span, message, "a key without `:`", help=repair)


def too_large(size: int, most: int, span: Span) -> Diagnostic:
    """E0119: a file with too many characters."""
    return error("E0119", span, f"the file has {size:,} characters, more than {most:,}")


def malformed_json(problem: str, span: Span) -> Diagnostic:
    """E0120: a .json file that is not JSON."""
    return error("E0120", span, f"not valid JSON: {problem}", "cannot be read from here on")


def missing_colon(text: str, span: Span) -> Diagnostic:
    """E0121: a line that should be a key and has no colon."""
    label = "neither a key nor part of a value"
    # other texts may be half of a value: adding a colon would make nonsense of them
    meant = f"{text}:" if text.isidentifier() else None
    repair = f"for a key write `{meant}`" if meant else "a key ends with `:`"
    message = "this line has no `:`"
    return error("E0121", span, message, label, help=repair, replacement=meant)


def open_bracket(bracket: str, span: Span) -> Diagnostic:
    """E0122: a YAML list or mapping in brackets that goes wrong."""
    message = f"the `{bracket}` that starts here is not closed as it should be"
    repair = "check commas, colons, quotes and brackets after it"
    return error("E0122", span, message, "opened here", help=repair)


def misplaced_line(span: Span) -> Diagnostic:
    """E0123: a line whose indentation fits no line above."""
    message = "the indentation fits no line above"
    repair = "begin it in the column of the entries that it stands beside"
    return error("E0123", span, message, "starts in an unexpected column", help=repair)


def misplaced_item(span: Span) -> Diagnostic:
    """E0124: `- ` after a key."""
    message = "a list entry cannot start on the line of its key"
    repair = "for a minus sign quote the value, or leave no blank after it"
    return error("E0124", span, message, "`- ` starts a list entry", help=repair)


def open_quote(span: Span) -> Diagnostic:
    """E0125: a quoted text without its end."""
    return error("E0125", span, "this quoted text never ends", "opened here")


def unknown_escape(span: Span) -> Diagnostic:
    """E0126: a backslash with something unknown behind it."""
    message = "this is not an escape that YAML knows"
    return error("E0126", span, message, "in a text in double quotes", help="use single quotes")


def block_text(indicator: str, span: Span) -> Diagnostic:
    """E0127: a value that starts with `>` or `|`."""
    message = f"`{indicator}` starts a block of text, which begins on the next line"
    return error("E0127", span, message, "not a comparison", help="quote the value")


def reserved_start(character: str, span: Span) -> Diagnostic:
    """E0128: a value that starts with a character reserved by YAML."""
    # the sentence quotes by backticks
    shown = "a backtick" if character == "`" else f"`{character}`"
    message = f"an unquoted value cannot start with {shown}"
    return error("E0128", span, message, "reserved by YAML", help="quote the value")

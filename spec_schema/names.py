"""Decides which words are valid names, and which are reserved."""

import keyword
import re
import unicodedata

NAME_PATTERN = "[A-Za-zͰ-Ͽ][A-Za-z0-9_Ͱ-Ͽ]*"
LONGEST_NAME = 100
"""Maximum characters: names become file names, which systems limit to 255 bytes."""
_NAME = re.compile(NAME_PATTERN)
_TAKEN = {
    "t": "it is the index of time",
    "dt": "it is the sample time",
    "pi": "it is the number π",
}
RESERVED_PATTERN = "|".join((*_TAKEN, *keyword.kwlist))


def normalised(name: str) -> str:
    """Normalises to NFKC, like Python's parser for names in expressions."""
    return unicodedata.normalize("NFKC", name)


def is_name(name: str) -> bool:
    """Whether a text, once normalised, follows the grammar of NAME.

    `x²` does not, although NFKC makes `x2` of it: nobody means that.
    """
    return (
        len(name) <= LONGEST_NAME
        and name.isidentifier()
        and _NAME.fullmatch(normalised(name)) is not None
    )


def similar_name(text: str) -> str | None:
    """A valid name similar to an invalid text: `x_dot` for `x-dot`; None without one."""
    found = re.sub("[^A-Za-z0-9_Ͱ-Ͽ]+", "_", normalised(text)).strip("_")
    return found if is_name(found) and why_reserved(found) is None else None


def is_dotted_name(name: str) -> bool:
    """True if a text consists of names with dots, such as a member of a sub-model."""
    parts = name.split(".")
    return len(parts) > 1 and all(is_name(part) for part in parts)


def why_reserved(name: str) -> str | None:
    """The reason why a name is reserved; None if it is available."""
    # expressions are parsed by Python, which reads `lambda` otherwise
    return _TAKEN.get(name) or ("it is a reserved word of Python" if is_python_word(name) else None)


def is_python_word(name: str) -> bool:
    """True if the expression parser, which is Python's, cannot read it as a name."""
    return keyword.iskeyword(name)

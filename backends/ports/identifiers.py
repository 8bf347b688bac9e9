"""Converts names of a spec to identifiers that C and C++ compilers and most tools accept."""

from __future__ import annotations

import re
import unicodedata

LONGEST = 48
"""Maximum length; C99 guarantees 63 significant characters, and prefixes and suffixes need some."""

_C_WORDS = """
auto break case char const continue default do double else enum extern float for goto if inline int
long register restrict return short signed sizeof static struct switch typedef union unsigned void
volatile while
"""
_CPP_WORDS = """
alignas alignof and and_eq asm bitand bitor bool catch char8_t char16_t char32_t class compl concept
const_cast consteval constexpr constinit co_await co_return co_yield decltype delete dynamic_cast
explicit export false friend mutable namespace new noexcept not not_eq nullptr operator or or_eq
private protected public reinterpret_cast requires static_assert static_cast template this
thread_local throw true try typeid typename using virtual wchar_t xor xor_eq
"""
_MACROS_AND_TYPES = """
assert complex errno imaginary linux unix vax i386 near far interrupt huge main
NULL NAN INFINITY EOF TRUE FALSE BOOL PI DEBUG NDEBUG ERROR OK DOMAIN OVERFLOW UNDERFLOW
int8_t int16_t int32_t int64_t uint8_t uint16_t uint32_t uint64_t size_t
"""
# compilers warn if one of these is shadowed
_LIBRARY_FUNCTIONS = """
abs acos acosh asin asinh atan atan2 atanh cbrt ceil cos cosh div erf erfc exp exp2 expm1 fabs fabsf
floor fma fmax fmin fmod frexp gamma hypot index isinf isnan j0 j1 jn ldexp lgamma log log10 log1p
log2 logb lrint modf nan pow printf rand remainder remquo rint round signal sin sinf sinh sqrt sqrtf
strlen tan tanh tgamma time trunc y0 y1 yn
"""
_RESERVED = frozenset((_C_WORDS + _CPP_WORDS + _MACROS_AND_TYPES + _LIBRARY_FUNCTIONS).split())


def c_identifier(name: str, taken: set[str], numbers: dict[str, int] | None = None) -> str:
    """An identifier for `name` that is not in `taken`; it is added to `taken`.

    Greek letters are spelled out, other foreign characters and dots become `_`. The result is a
    letter followed by ASCII letters, digits and single `_`, with at most 48 characters. It is not a
    reserved word of C, C++ or their headers. A name that is already taken gets a number. The same
    arguments give the same result.

        c_identifier("vehicle.ρ_hat", set()) == "vehicle_rho_hat"

    `numbers` stores for each name the first number that may be free, for speed with many similar
    names; it requires that nothing is removed from `taken`.
    """
    base = _plain(name)
    if base in _RESERVED:
        base = f"{base}_"
    candidate = base
    number = 2 if numbers is None else numbers.get(base, 2)
    while candidate in taken:
        suffix = f"_{number}"
        candidate = f"{base[: LONGEST - len(suffix)].rstrip('_')}{suffix}"
        number += 1
    if numbers is not None:
        numbers[base] = number
    taken.add(candidate)
    return candidate


def ascii_text(text: str) -> str:
    """The text in ASCII: Greek letters by name, accents dropped, other characters such as `µ`
    replaced by similar ones or by `U+XXXX`.
    """
    return "".join(_ascii_character(character) for character in text)


def _plain(name: str) -> str:
    spelled = "".join(
        character if character.isascii() else _spelled(character) or "_" for character in name
    )
    plain = re.sub(r"[^A-Za-z0-9]+", "_", spelled).strip("_")
    # names that start with _ are reserved for compilers and libraries
    if not plain or not plain[0].isalpha():
        plain = f"v_{plain}".rstrip("_")
    # names that are equal up to this length get numbers
    return plain[:LONGEST].rstrip("_")


def _ascii_character(character: str) -> str:
    if character.isascii():
        return character
    return _SYMBOLS.get(character) or _spelled(character) or f"U+{ord(character):04X}"


_SYMBOLS = {"µ": "u", "°": "deg", "·": "*", "×": "x", "−": "-", "–": "-", "—": "-", "…": "..."}


def _spelled(character: str) -> str:
    """A non-ASCII character in ASCII: `rho` for ρ, `Omega` for Ω, `e` for é; empty for one without
    such a spelling.
    """
    words = unicodedata.name(character, "").split(" WITH ")[0].split()
    match words:
        case ["GREEK", "SMALL", "LETTER", *_, letter]:
            return "lambda" if letter == "LAMDA" else letter.lower()
        case ["GREEK", "CAPITAL", "LETTER", *_, letter]:
            return "Lambda" if letter == "LAMDA" else letter.capitalize()
        case _:
            decomposed = unicodedata.normalize("NFKD", character)
            return "".join(part for part in decomposed if part.isascii() and part.isprintable())

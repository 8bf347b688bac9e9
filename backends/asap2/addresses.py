"""Writes addresses into an ASAP2 file and leaves all other text unchanged."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeAlias

# comments, strings and words, as the standard has them: a keyword within a string is none
_TOKEN = re.compile(r'/\*.*?\*/|//[^\n]*|"(?:\\.|""|[^"\\])*"|[^\s"]+', re.DOTALL)
_BLOCKS = ("CHARACTERISTIC", "MEASUREMENT", "AXIS_PTS", "MEMORY_SEGMENT")


@dataclass(frozen=True, slots=True)
class Symbol:
    """An object in the linked program: the name of its variable, for a member with it after a dot
    (`veh_params_default.gain`), and its address.
    """

    name: str
    address: int


Find: TypeAlias = Callable[[str], Symbol | None]
"""Returns the symbol for the name of a link or memory segment, or for `EPK` and its text; None
leaves the object unchanged."""


@dataclass(frozen=True, slots=True)
class _Token:
    text: str
    begin: int
    end: int


def filled(text: str, find: Find, *, big_endian: bool = False) -> str:
    """The text of an ASAP2 file with addresses and symbol names of those objects for which `find`
    gives a symbol, and with the byte order of the processor (`big_endian`). All other text stays.
    """
    changes: list[tuple[_Token, str]] = []
    tokens = list(_tokens(text))
    order = "MSB_FIRST" if big_endian else "MSB_LAST"
    for before, token in pairwise(tokens):
        if before.text == "BYTE_ORDER":
            changes.append((token, order))
        if before.text == "EPK" and (symbol := find(f"EPK {token.text[1:-1]}")) is not None:
            changes.append((before, f"ADDR_EPK 0x{symbol.address:X} EPK"))
    for block in _objects(tokens):
        place, link = _address(block), _behind(block, "SYMBOL_LINK")
        named = block[1].text if block[0].text == "MEMORY_SEGMENT" else ""
        symbol = find(named if link is None else link.text[1:-1])
        if place is not None and symbol is not None:
            changes.append((place, f"0x{symbol.address:X}"))
            if link is not None:
                changes.append((link, f'"{symbol.name}"'))
    # from the end to the front: places before a change stay where they are
    for token, new in sorted(changes, key=lambda change: change[0].begin, reverse=True):
        text = text[: token.begin] + new + text[token.end :]
    return text


def linked(text: str) -> list[str]:
    """The names in all `SYMBOL_LINK` entries of an ASAP2 file, in their order."""
    tokens = [token.text for token in _tokens(text)]
    pairs = pairwise(tokens)
    return [after[1:-1] for before, after in pairs if before == "SYMBOL_LINK"]


def epk(text: str) -> str | None:
    """The EPK of an ASAP2 file, a text by which a tool checks that the program in a device belongs
    to the file; None if there is none.
    """
    pairs = pairwise(token.text for token in _tokens(text))
    return next((after[1:-1] for before, after in pairs if before == "EPK"), None)


def _tokens(text: str) -> Iterator[_Token]:
    for found in _TOKEN.finditer(text):
        # comments stay in the file: they are no tokens, but their text is not touched
        if not found[0].startswith(("/*", "//")):
            yield _Token(found[0], found.start(), found.end())


def _objects(tokens: list[_Token]) -> Iterator[list[_Token]]:
    """The tokens of each object that has an address, from its keyword (such as CHARACTERISTIC) up
    to `/end`.
    """
    begin: int | None = None
    # /end stands before the keyword of what it ends
    for index, token in enumerate(tokens[:-1]):
        kind = tokens[index + 1].text
        if kind in _BLOCKS and token.text == "/begin":
            begin = index + 1
        elif kind in _BLOCKS and token.text == "/end" and begin is not None:
            yield tokens[begin:index]
            begin = None


def _address(block: list[_Token]) -> _Token | None:
    """The token with the address of an object, given by its tokens; None if it has none."""
    position = {"CHARACTERISTIC": 4, "AXIS_PTS": 3, "MEMORY_SEGMENT": 6}.get(block[0].text)
    if position is None:
        return _behind(block, "ECU_ADDRESS")
    return block[position] if position < len(block) else None


def _behind(block: list[_Token], keyword: str) -> _Token | None:
    return next((after for before, after in pairwise(block) if before.text == keyword), None)

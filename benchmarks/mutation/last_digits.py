"""Changes each constant of generated math functions to a neighbouring number."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

_Change = tuple[int, int, str]

_FUNCTION = re.compile(r"^[^\n#/{} ][^\n#/{}]*\([^;{}]*\)\n\{\n(.*?)^\}", re.DOTALL | re.MULTILINE)
_REAL = re.compile(r"(?<![\w.])(0x[0-9a-f.]+p[-+]\d+|\d+\.\d*(?:e[-+]?\d+)?)(f?)\b")
_WORD = re.compile(r"(?<![\w.])(0x[0-9a-fA-F]+|\d{4,})U\b")


def last_digits(code: str) -> Iterator[tuple[_Change, ...]]:
    """Yields the changes: a float to the next one above or below, an integer by one."""
    for body in _FUNCTION.finditer(code):
        for match in _REAL.finditer(body[1]):
            text, suffix = match[1], match[2]
            real = np.float32 if suffix else np.float64
            value = real(float.fromhex(text) if text.startswith("0x") else float(text))
            at = body.start(1) + match.start(), body.start(1) + match.end()
            for towards in (-np.inf, np.inf):
                with np.errstate(over="ignore"):
                    beside = float(np.nextafter(value, real(towards)))
                if np.isfinite(beside):
                    yield ((*at, f"{beside.hex()}{suffix}"),)
        for match in _WORD.finditer(body[1]):
            at = body.start(1) + match.start(), body.start(1) + match.end()
            yield ((*at, f"{int(match[1], 0) ^ 1}U"),)

"""Interprets decimal commas, which YAML does not support, for suggested repairs."""

import re

_DECIMAL_COMMA = re.compile(r"([+-]?\d+),(\d+)((?:[^\d,][^,]*)?)")


def with_point_or_joined(text: str) -> tuple[str, ...]:
    """Lists possible meanings: `2.5` for `2,5`; for `1,200` first 1200, then `1.200`."""
    point, joined = text.replace(",", "."), text.replace(",", "")
    return (point,) if with_decimal_point(text) else (joined, point)


def with_decimal_point(text: str) -> str | None:
    """`0.05 s` for `0,05 s`; None without a comma, or if it may separate thousands."""
    found = _DECIMAL_COMMA.fullmatch(text.strip())
    # `1,500` is fifteen hundred to some and one and a half to others
    if found is None or (len(found[2]) == 3 and found[1].lstrip("+-") != "0"):
        return None
    return f"{found[1]}.{found[2]}{found[3]}"

"""Reads a decimal comma, which YAML does not, for the repair that a message names."""

import re

_DECIMAL_COMMA = re.compile(r"([+-]?\d+),(\d+)((?:[^\d,][^,]*)?)")


def with_point_or_joined(text: str) -> tuple[str, ...]:
    """Lists what `2,5` may mean, `2.5`; of `1,200` the number without a comma, then `1.200`."""
    point, joined = text.replace(",", "."), text.replace(",", "")
    return (point,) if with_decimal_point(text) else (joined, point)


def with_decimal_point(text: str) -> str | None:
    """`0.05 s` for `0,05 s`; None without a comma, or with one that may part thousands."""
    found = _DECIMAL_COMMA.fullmatch(text.strip())
    # `1,500` is fifteen hundred to some and one and a half to others
    if found is None or (len(found[2]) == 3 and found[1].lstrip("+-") != "0"):
        return None
    return f"{found[1]}.{found[2]}{found[3]}"

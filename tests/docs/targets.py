"""The targets of exports, from their table and their records."""

from __future__ import annotations

from msnn.exports.export import target_named
from msnn.exports.table import TARGETS, ListedTarget
from tests.docs.markdown import table


def targets() -> str:
    """A row a target."""
    header = ("target", "writes", "computes in", "keeps", "extras", "`msnn verify`")
    return table(header, [_row(listed) for listed in TARGETS])


def _row(listed: ListedTarget) -> tuple[str, ...]:
    target = target_named(listed.name)
    extras = [package.extra for package in (listed.writer, listed.runner) if package is not None]
    return (
        f"`{listed.name}`",
        listed.about,
        target.dtype,
        target.promise(target.dtype).value,
        ", ".join(f"`{extra}`" for extra in extras),
        "●" if target.is_verified else "",
    )

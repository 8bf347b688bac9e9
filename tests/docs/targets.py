"""The targets of exports, from their table and their records."""

from __future__ import annotations

from msnn.exports.export import target_named
from msnn.exports.table import TARGETS, ListedTarget
from tests.docs.markdown import table


def targets() -> str:
    """A row a target."""
    header = ("target", "writes", "computes in", "keeps", "to run it", "`msnn verify`")
    return table(header, [_row(listed) for listed in TARGETS])


def _row(listed: ListedTarget) -> tuple[str, ...]:
    target = target_named(listed.name)
    package = "" if listed.package is None else f"`pip install 'msnn[{listed.package.extra}]'`"
    return (
        f"`{listed.name}`",
        listed.about,
        target.dtype,
        target.promise(target.dtype).value,
        package,
        "●" if target.is_verified else "",
    )

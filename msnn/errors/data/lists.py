"""Lists names in messages, and counts what they do not list."""

from collections.abc import Sequence

_LISTED = 12
_LONGEST = 60
"""Characters of a name."""


def listed(names: Sequence[str]) -> str:
    shown = ", ".join(map(shortened, names[:_LISTED]))
    return f"{shown}, … ({len(names)} in all)" if len(names) > _LISTED else shown


def shortened(name: str) -> str:
    """A name of a file as a person can read it: a line without line ends may be megabytes long."""
    return name if len(name) <= _LONGEST else f"{name[:_LONGEST]}… ({len(name):,} characters)"


def and_more(count: int, what: str) -> tuple[str, ...]:
    """A note that counts further faults of one kind."""
    if not count:
        return ()
    return (f"{count} more {what}{'s' if count > 1 else ''} of this kind in the file",)

"""Lists names in messages, and counts what they do not list."""

from collections.abc import Sequence

_LISTED = 12


def listed(names: Sequence[str]) -> str:
    shown = ", ".join(names[:_LISTED])
    return f"{shown}, … ({len(names)} in all)" if len(names) > _LISTED else shown


def and_more(count: int, what: str) -> tuple[str, ...]:
    """A note that counts further faults of one kind."""
    if not count:
        return ()
    return (f"{count} more {what}{'s' if count > 1 else ''} of this kind in the file",)

"""E0869: data that are kept on disk as they are larger than memory."""

from spec_schema.diagnostics.diagnostic import Diagnostic, error
from spec_schema.diagnostics.source import Span


def not_on_disk(
    reason: str, span: Span | None, repair: str | None = None, why: tuple[str, ...] = ()
) -> Diagnostic:
    """E0869: what is not done with data that are kept on disk."""
    usual = "leave `keep: disk` out where the data fit into memory, else leave that out"
    message = f"`keep: disk` does not go with this: {reason}"
    return error("E0869", span, message, notes=why, help=repair or usual)

"""Gives up a value after a mistake, whose diagnostic is kept, so that lowering can go on."""


class LoweringFailed(Exception):  # noqa: N818  (no error of its own: the diagnostic is)
    """The value has a mistake that is already reported; whoever needs it fails silently."""

"""Signals a value that cannot be lowered, after its mistake was reported."""


class LoweringFailed(Exception):  # noqa: N818  (no error of its own: the diagnostic is)
    """The value has a mistake that has been reported; values that depend on it fail silently."""

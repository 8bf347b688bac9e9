"""How lowering goes on after a mistake: the diagnostic is kept, the value is given up."""


class LoweringFailed(Exception):  # noqa: N818  (no error of its own: the diagnostic is)
    """The value has a mistake that is already reported; whoever needs it fails silently."""

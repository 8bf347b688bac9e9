"""E1301, W1301: exports that data are run through."""

from spec_schema.diagnostics.diagnostic import Diagnostic, error, warning


def engine_of_words(dtype: str) -> Diagnostic:
    """E1301: data to be run through C that computes in fixed point."""
    message = f"`export: c` says `dtype: {dtype}`, and data have numbers with units, not words"
    repair = "add `--set export.c.dtype=float32`; `msnn export --check` runs C in fixed point"
    return error("E1301", None, message, help=repair)


def losses_are_interpreted(engine: str) -> Diagnostic:
    """W1301: a loss to be measured of an export, which has outputs and no losses."""
    message = f"losses are computed by the interpreter: the engine `{engine}` has outputs alone"
    return warning("W1301", None, message)

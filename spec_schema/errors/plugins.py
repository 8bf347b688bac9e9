"""E0230, W0222, W0956: plug-ins."""

from traceback import format_exception, walk_tb

from spec_schema.diagnostics.diagnostic import Diagnostic, error, warning
from spec_schema.diagnostics.source import Span

OTHER_VERSION = "W0956"
"""The code of warnings about plug-ins of another version."""
_LONGEST_REASON = 200
"""Maximum number of characters of an exception's message."""

TRACEBACKS: list[str] = []
"""Of exceptions of plug-ins that were reported during the running command, for `--verbose`."""


def left_out(package: str, part: str, reason: str, repair: str) -> Diagnostic:
    """W0222: a plug-in, or one of its names, that is left out."""
    message = f"{part} of the package {package} is left out: {reason}"
    return warning("W0222", None, message, help=repair)


def faulty_plugin(package: str, part: str, fault: str, place: Span | None = None) -> Diagnostic:
    """E0230: a part of a plug-in that raises an exception, or returns a wrong value."""
    message = f"{part} of the package {package} {fault}"
    repair = f"report it to the authors of {package}, or install another version of it"
    return error("E0230", place, message, help=repair)


def other_version(what: str, package: str, then: str | None, now: str) -> Diagnostic:
    """W0956: a plug-in that is installed in another version than the run was made with."""
    if then is None:
        message = f"{what} without a plug-in, and {package} {now} is installed now"
        repair = f"remove {package} for the values of that time, or train again"
    else:
        message = f"{what} with {package} {then}, and {now} is installed"
        repair = f"install {package} {then} for the values of that time, or train again with {now}"
    return warning("W0956", None, f"{message}: results may differ", help=repair)


def what_was_raised(raised: BaseException, module: str) -> str:
    """A text about the exception `raised` by a plug-in's `module`: its type and message, and the
    last line in the traceback that is in the plug-in's own package.

    Functions of other packages that it calls are seldom at fault.
    """
    keep_traceback(raised)
    lines = [
        f"{frame.f_globals['__name__']}, line {line}, in {frame.f_code.co_name}"
        for frame, line in walk_tb(raised.__traceback__)
        if _package(str(frame.f_globals.get("__name__"))) == _package(module)
    ]
    reason = " ".join(str(raised).split())[:_LONGEST_REASON]
    name = type(raised).__name__
    at = f" ({lines[-1]})" if lines else ""
    return f"raised {name}{f': {reason}' if reason else ''}{at}"


def keep_traceback(raised: BaseException) -> None:
    """Adds the traceback of an exception of a plug-in to `TRACEBACKS`, once."""
    text = "".join(format_exception(raised))
    if text not in TRACEBACKS:
        TRACEBACKS.append(text)


def _package(module: str) -> str:
    return module.partition(".")[0]

"""Handles Ctrl-C and SIGTERM identically, from the first import on."""

from __future__ import annotations

import os
import sys

TYPE_CHECKING = False  # `typing` takes long to load
if TYPE_CHECKING:
    from typing import Any

_HEARD: list[int] = []
"""Received interrupt signals of this process."""
INTERRUPTED = 130  # ExitCode.INTERRUPTED, which is not loaded yet


def expect_early_interrupts() -> None:
    """Replaces the exception hook of `msnn`, so that Ctrl-C prints no traceback while it is
    loading, before `main` runs.

    Does not affect other programs that import msnn.
    """
    # while a package is imported for `python -m`, that is all that Python says of it
    is_module = sys.argv[:1] == ["-m"] and "msnn" in sys.orig_argv
    if is_module or _name() in ("msnn", "msnn.exe"):
        sys.excepthook = _told


def _name() -> str:
    return os.path.basename(sys.argv[0]) if sys.argv else ""  # noqa: PTH119  (pathlib loads long)


def _told(kind: type[BaseException], error: BaseException, trace: Any) -> None:
    if not is_interrupt(error):
        sys.__excepthook__(kind, error, trace)
        return
    print("interrupted", file=sys.stderr, flush=True)
    os._exit(INTERRUPTED)


def interrupt_on_signals() -> None:
    """Lets Ctrl-C and SIGTERM raise KeyboardInterrupt, unless the process ignores the signal."""
    import signal

    for number in (signal.SIGINT, signal.SIGTERM):
        # `nohup` and shells that start a job in the background set SIG_IGN, which is a wish to be
        # left alone
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _interrupt)


def _interrupt(number: int, frame: object) -> None:
    del frame
    _HEARD.append(number)
    raise KeyboardInterrupt


def was_interrupted() -> bool:
    """True if a signal was received, even if a library caught its KeyboardInterrupt."""
    return bool(_HEARD)


def is_interrupt(error: BaseException) -> bool:
    """True if an exception is KeyboardInterrupt or was caused by one; libraries may wrap it."""
    found: BaseException | None = error
    while found is not None:
        if isinstance(found, KeyboardInterrupt):
            return True
        # `raise … from error` sets the cause, an error while another is handled only the context
        found = found.__cause__ or found.__context__
    return False

"""Ends a command at Ctrl-C and SIGTERM in the same way, from its first import on."""

from __future__ import annotations

import signal


def interrupt_on_signals() -> None:
    """Lets Ctrl-C and SIGTERM raise KeyboardInterrupt; one that the process ignores stays so."""
    for number in (signal.SIGINT, signal.SIGTERM):
        # `nohup` and shells that start a job in the background set SIG_IGN, which is a wish to be
        # left alone
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, signal.default_int_handler)


def is_interrupt(error: BaseException) -> bool:
    """Whether KeyboardInterrupt is behind an error: libraries turn it into errors of their own."""
    found: BaseException | None = error
    while found is not None:
        if isinstance(found, KeyboardInterrupt):
            return True
        # `raise … from error` sets the cause, an error while another is handled only the context
        found = found.__cause__ or found.__context__
    return False

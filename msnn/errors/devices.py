"""E0970-E0979: where torch computes."""

from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import Span
from spec_schema.diagnostics.suggest import nearest

_NAMES = ("cpu", "cuda", "cuda:0", "auto")
_CARDS = ("gpu", "nvidia")


def no_kernel_on_card(stage: str, device: str, span: Span | None) -> Diagnostic:
    """E0970: native kernels asked for on a graphics card."""
    return Diagnostic(
        "E0970",
        "error",
        f"the stage `{stage}` cannot run on {device}: native kernels are for the CPU",
        span,
        "native engine",
        help="use `engine: auto` or `engine: torch`, or train with `--device cpu`",
    )


def unknown_device(name: str) -> Diagnostic:
    """E0971: a device that torch computes on nowhere."""
    meant = "cuda" if name.casefold() in _CARDS else nearest(name, _NAMES)
    known = "the devices are cpu, cuda, cuda:N for card N counted from 0, and auto"
    return Diagnostic(
        "E0971",
        "error",
        f"`{name}` is no device",
        None,
        help=f"did you mean `{meant}`? {known}" if meant else known,
    )


def no_such_card(name: str, cards: int) -> Diagnostic:
    """E0972: a graphics card that this machine does not have."""
    there = ", ".join(f"cuda:{number}" for number in range(cards))
    return Diagnostic(
        "E0972",
        "error",
        f"there is no `{name}` here",
        None,
        help=f"torch can use {there}; cards are counted from 0",
    )

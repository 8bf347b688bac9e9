"""E0970-E0972: where torch computes."""

from spec_schema.diagnostics.diagnostic import Diagnostic, error
from spec_schema.diagnostics.source import Span
from spec_schema.diagnostics.suggest import nearest

_NAMES = ("cpu", "cuda", "cuda:0", "auto")
_CARDS = ("gpu", "nvidia")


def no_kernel_on_card(stage: str, device: str, span: Span | None) -> Diagnostic:
    """E0970: native kernels asked for on a graphics card."""
    message = f"the stage `{stage}` cannot run on {device}: native kernels are for the CPU"
    repair = "use `engine: auto` or `engine: torch`, or train with `--device cpu`"
    return error("E0970", span, message, "native engine", help=repair)


def unknown_device(name: str) -> Diagnostic:
    """E0971: a device that torch computes on nowhere."""
    meant = "cuda" if name.casefold() in _CARDS else nearest(name, _NAMES)
    known = "the devices are cpu, cuda, cuda:N for card N counted from 0, and auto"
    repair = f"did you mean `{meant}`? {known}" if meant else known
    return error("E0971", None, f"`{name}` is no device", help=repair)


def no_such_card(name: str, cards: int) -> Diagnostic:
    """E0972: a graphics card that this machine does not have."""
    there = ", ".join(f"cuda:{number}" for number in range(cards))
    message = f"there is no `{name}` here"
    return error("E0972", None, message, help=f"torch can use {there}; cards are counted from 0")

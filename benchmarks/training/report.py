"""The result as Markdown: times, ratios, share of the machine, agreement, verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import median

from agreement import GRADIENT_LIMIT, LOSS_LIMIT, Agreement
from machine import QUIET
from worker import JAX, KERNEL, NATIVE, PEER
from workloads import Workload

GOALS: Mapping[tuple[str, str], float] = {
    ("a", PEER): 100, ("b", PEER): 1000, ("c", PEER): 1000, ("b32", PEER): 3000,
    ("d16", PEER): 1000, ("d64", PEER): 1000,
    ("a", JAX): 4, ("b", JAX): 12, ("c", JAX): 10,
}  # fmt: skip
"""How many times faster msnn is to be; no round may be below half of it."""

SHARES = {"b": 0.25, "c": 0.25}
"""Share of the peak of one core's multiply-adds that is to be reached."""

_EPOCHS = 100
"""Epochs of the end-to-end figure."""


@dataclass(frozen=True, slots=True)
class Measured:
    """The times of all tools for one workload at one batch size."""

    case: str
    workload: Workload
    batch: int
    steps: int
    """Samples times steps of an epoch."""
    times: Mapping[str, Sequence[float]]
    """Seconds an epoch by tool, one a round."""
    builds: Mapping[str, float | None]
    agreement: Agreement
    load: tuple[float, float]
    processor: bool
    """Whether seconds are those of processors."""

    @property
    def quiet(self) -> bool:
        """True if other work on the machine did not change the times."""
        return self.processor or max(self.load) <= QUIET

    def quotients(self, tool: str, of: str = NATIVE) -> list[float]:
        """The time of `tool` divided by that of `of`, for each round."""
        return [a / b for a, b in zip(self.times[tool], self.times[of], strict=True)]


def markdown(found: Sequence[Measured], peak: float, where: str) -> str:
    """The report as Markdown; `peak` is the speed of the machine in GFLOP/s, `where`
    describes it.
    """
    parts = [
        f"Measured {where}. Peak of one core: {peak:.0f} GFLOP/s (float32 multiply-adds).",
        _times(found, peak),
        _goals(found, peak),
        _agreement(found),
    ]
    return "\n\n".join(parts)


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _times(found: Sequence[Measured], peak: float) -> str:
    head = ("workload", "tool", "ms an epoch", "min … max", "times the peer's speed (worst round)",
            "share of peak", "build, s",
            f"{_EPOCHS} epochs with the build, times the peer's speed")  # fmt: skip
    rows: list[Sequence[str]] = []
    for measured in found:
        operations = measured.steps * measured.workload.operations
        for tool, times in measured.times.items():
            typical, build = median(times), measured.builds[tool]
            faster = measured.quotients(PEER, tool) if PEER in measured.times else []
            share = operations / typical / 1e9 / peak
            rows.append((
                f"{measured.case}, batch {measured.batch}",
                tool,
                f"{1e3 * typical:.3f}",
                f"{1e3 * min(times):.3f} … {1e3 * max(times):.3f}",
                f"{median(faster):.1f} ({min(faster):.1f})" if faster else "",
                f"{100 * share:.2f} %",
                "" if build is None else f"{build:.1f}",
                _end_to_end(measured, tool),
            ))  # fmt: skip
    return _table(head, rows)


def _end_to_end(measured: Measured, tool: str) -> str:
    build = measured.builds[tool]
    if build is None or PEER not in measured.times:
        return ""
    whole = build + _EPOCHS * median(measured.times[tool])
    return f"{_EPOCHS * median(measured.times[PEER]) / whole:.1f}"


def _goals(found: Sequence[Measured], peak: float) -> str:
    rows: list[Sequence[str]] = []
    for measured in found:
        for tool in (PEER, JAX):
            goal = GOALS.get((measured.case, tool))
            if goal is None or tool not in measured.times:
                continue
            ratios = measured.quotients(tool)
            met = median(ratios) >= goal and min(ratios) >= goal / 2
            rows.append((
                measured.case, f"faster than {tool}", f"{goal:.0f}×, worst {goal / 2:.0f}×",
                f"{_ratio(median(ratios))}, worst {_ratio(min(ratios))}",
                _verdict(measured, met, tool),
            ))  # fmt: skip
        if measured.case in SHARES:
            operations = measured.steps * measured.workload.operations
            share = operations / median(measured.times[NATIVE]) / 1e9 / peak
            goal = SHARES[measured.case]
            rows.append((measured.case, "share of peak", f"{goal:.0%}", f"{share:.0%}",
                         _verdict(measured, share >= goal, KERNEL)))  # fmt: skip
    return _table(("workload", "msnn native", "asked", "measured", "verdict"), rows)


def _ratio(value: float) -> str:
    return f"{value:.0f}×" if value >= 10 else f"{value:.2f}×"


def _verdict(measured: Measured, met: bool, tool: str) -> str:
    """A text: the goal is met or missed, the results do not agree, or other work disturbed the
    times.
    """
    if not measured.agreement.holds_with(tool):
        return "no: the results do not agree"
    if not measured.quiet:
        return f"not judged: load above {QUIET}"
    return "met" if met else "missed"


def _agreement(found: Sequence[Measured]) -> str:
    head = ("workload", f"gradient from float64 (≤ {GRADIENT_LIMIT:g})",
            f"losses of 3 epochs in fixed order, from msnn native's (≤ {LOSS_LIMIT:g})",
            "load before, after")  # fmt: skip
    rows = [
        (
            measured.case,
            f"{measured.agreement.gradient:.1e}",
            ", ".join(f"{tool} {x:.1e}" for tool, x in measured.agreement.losses.items()),
            f"{measured.load[0]:.2f}, {measured.load[1]:.2f}",
        )
        for measured in found
    ]
    return _table(head, rows)

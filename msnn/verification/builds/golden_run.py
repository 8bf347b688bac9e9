"""Compares a build's output for the golden vectors with the interpreter's bits."""

from __future__ import annotations

import re

from msnn.verification.exported_c import ExportedC

_SUMMARY = re.compile(r"differing ([0-9a-f]{8}) selftest ([0-9a-f]{8})")


def differences(model: ExportedC, answer: str) -> list[str]:
    """The differences in the output of the test harness, as sentences; empty if there are none."""
    lines = [line.strip() for line in answer.splitlines() if line.strip()]
    # printed last: a board that trapped or hung has answered steps and no summary
    summary = next((m for line in lines if (m := _SUMMARY.search(line))), None)
    if summary is None:
        return ["the program ended before its last golden step"]
    found: list[str] = []
    # the program replays as many steps as there are answers: with none of them it compares nothing
    if (wanted := len(model.expected)) != (steps := model.golden_steps):
        found.append(f"answers of {wanted} golden steps are kept, the vectors have {steps}")
    if int(summary[2], 16) != 0:
        found.append(f"the self-test returned 0x{summary[2]}")
    if (count := int(summary[1], 16)) != 0:
        found.append(f"{count} golden steps or starts differ by more than the export promises")
    if model.exact:
        answered = lines[: len(model.expected)]
        # an answer that is too short meets the summary's line here, which is no step
        for step, (got, wanted) in enumerate(zip(answered, model.expected, strict=False)):
            if got != wanted:
                found.append(f"step {step} answered {got}, not {wanted}")
                break
    return found

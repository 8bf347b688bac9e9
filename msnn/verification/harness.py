"""Writes C test programs around an export, and finds differences from the expected bits in their
output.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import templates
from backends.files.text_templates import text_templates
from msnn.verification.boards import Board
from msnn.verification.exported_c import ExportedC

TEMPLATES = Path(templates.__path__[0]) / "verify"

_LAG = 3
"""Number of golden steps by which a second instance lags behind the first."""


def write_harness(template: str, model: ExportedC, folder: Path, **facts: Any) -> Path:
    """Writes the C file of a template in `templates/verify/` for an export into `folder`; returns
    its path.

    `facts` are further values for the template.
    """
    return write_template(template, folder, **_facts(model), **facts)


def harness_text(template: str, model: ExportedC) -> str:
    """The text of a template in `templates/verify/` for an export; writes no file."""
    return _text(template, _facts(model))


def write_template(template: str, folder: Path, **facts: Any) -> Path:
    """Writes a template in `templates/verify/`, filled in with `facts`, into `folder`; returns its
    path.
    """
    path = folder / Path(template).name
    path.write_text(_text(template, facts), encoding="utf-8")
    return path


def write_linker_script(board: Board, folder: Path) -> Path:
    """Writes the linker script with the memory of a board; returns its path."""
    return write_template(
        "board.ld",
        folder,
        code_origin=hex(board.code[0]),
        code_length=board.code[1],
        ram_origin=hex(board.ram[0]),
        ram_length=board.ram[1],
    )


def _facts(model: ExportedC) -> dict[str, Any]:
    return {
        "prefix": model.prefix,
        "takes_parameters": model.takes_parameters,
        "params": f", &{model.prefix}_params_default" if model.takes_parameters else "",
        "count": len(model.expected),
        "lag": _LAG,
        "reals": model.reals,
        "number": model.number,
        "linearizes": model.linearizes,
        "hashed_reals": model.hashed_reals,
        "compares_states": model.compares_states,
    }


def _text(template: str, facts: dict[str, Any]) -> str:
    return text_templates("verify").get_template(f"{template}.j2").render(facts)


_SUMMARY = re.compile(r"differing ([0-9a-f]{8}) selftest ([0-9a-f]{8})")


def differences(model: ExportedC, answer: str) -> list[str]:
    """The values that differ from the expected bits, as sentences; empty if there are none.

    `answer` is the output of a test program that replays golden vectors.
    """
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

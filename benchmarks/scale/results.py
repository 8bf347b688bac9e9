"""Saves the measurements of this folder in RESULTS.md, one section per command."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

FILE = Path(__file__).with_name("RESULTS.md")
_TITLE = "# What sweeps, clusters and large data cost"


def write_section(command: str, lines: Sequence[str]) -> None:
    """Replaces or adds the section of a command, with the date and the load of the machine."""
    text = FILE.read_text(encoding="utf-8") if FILE.is_file() else f"{_TITLE}\n"
    script = command.partition(" ")[0]
    kept = re.sub(rf"\n## `{re.escape(script)}.*?(?=\n## |\Z)", "", text, flags=re.DOTALL)
    said = f"{datetime.now(UTC).date()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}."
    body = "\n".join(["", f"## `{command}`", "", said, "", "```", *lines, "```", ""])
    FILE.write_text(f"{kept.rstrip()}\n{body}", encoding="utf-8")

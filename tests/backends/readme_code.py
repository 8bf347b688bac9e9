"""Runs the example in a generated README as its reader would: copied into a file beside it."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path


def run_example(readme: Path) -> str:
    """What the only Python block of the README prints; AssertionError where it fails."""
    (code,) = re.findall(r"```python\n(.*?)```", readme.read_text(encoding="utf-8"), re.DOTALL)
    script = readme.parent / "example.py"
    script.write_text(code, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode == 0, done.stderr
    return done.stdout

"""Runs the examples in generated READMEs as their readers would: copied into files beside them."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

_RUN_ALL = """
import contextlib, io, json, runpy, sys
from pathlib import Path
printed = []
for script in sys.argv[1:]:
    folder = str(Path(script).parent)
    sys.path.insert(0, folder)
    with contextlib.redirect_stdout(io.StringIO()) as text:
        runpy.run_path(script, run_name="__main__")
    sys.path.remove(folder)
    for name, module in list(sys.modules.items()):
        if (getattr(module, "__file__", None) or "").startswith(folder):
            del sys.modules[name]
    printed.append(text.getvalue())
print(json.dumps(printed))
"""


def readme_code(readme: Path) -> str:
    """The Python blocks of a README, which go on where the one before ended."""
    blocks = re.findall(r"```python\n(.*?)```", readme.read_text(encoding="utf-8"), re.DOTALL)
    assert blocks
    return "\n".join(blocks)


def run_example(readme: Path) -> str:
    """What the Python blocks of the README print; AssertionError where they fail."""
    (printed,) = run_examples([readme])
    return printed


def run_examples(readmes: Sequence[Path]) -> list[str]:
    """The same of several, one after the other in one process: libraries are imported once."""
    scripts: list[str] = []
    for readme in readmes:
        script = readme.parent / "example.py"
        script.write_text(readme_code(readme), encoding="utf-8")
        scripts.append(str(script))
    done = subprocess.run(
        [sys.executable, "-c", _RUN_ALL, *scripts],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    printed: list[str] = json.loads(done.stdout)
    return printed

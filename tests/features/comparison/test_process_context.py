"""Processes that a server forks: what they import, and the environment that they see."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

LIKE_PYTHONS_OWN = "raise ImportError('a file of the working folder')\n"

PROGRAM = """
import os
from msnn.features.comparison.trial import Setup
from msnn.features.comparison.local_workers import _Workers

def seen():
    import sys
    return "fractions" in sys.modules, os.environ.get("GIVEN"), "PYTHONSAFEPATH" in os.environ

if __name__ == "__main__":
    nothing = Setup(data=None, data_root=None, held_out="val", runs=None, counts_cost=False)
    for given in ("one", "two"):
        os.environ["GIVEN"] = given
        with _Workers(nothing, {}, 1, ["fractions"]) as workers:
            with workers._all[0].opened() as pool:
                print(*pool.submit(seen).result())
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are started afresh there")
def test_a_worker_has_the_slow_modules_and_the_environment_of_now(tmp_path: Path):
    """The server lives as long as Python: not its environment counts, nor the working folder."""
    (tmp_path / "fractions.py").write_text(LIKE_PYTHONS_OWN)
    (tmp_path / "program").mkdir()
    program = tmp_path / "program" / "try_workers.py"
    program.write_text(PROGRAM)
    paths = os.pathsep.join(path for path in sys.path if path)
    done = subprocess.run(
        [sys.executable, str(program)],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": paths},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.splitlines() == ["True one False", "True two False"], done.stderr

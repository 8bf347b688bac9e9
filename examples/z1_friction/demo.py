"""Makes the data, learns the friction, compares it with its baselines, exports and uses it.

Everything is done by the commands that a user types; each is shown before it runs. What they
measured goes to `results.json` and README.
"""

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
ARM, COMPENSATOR = "z1_friction.msnn.yaml", "compensator.msnn.yaml"


def main() -> int:
    """Run the commands in the example's folder; ends with the exit code of the first that fails."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--set", action="append", default=[], help="passed on to `msnn train`")
    settings = [word for value in parser.parse_args().set for word in ("--set", value)]
    times: dict[str, tuple[float, float]] = {}
    for command in (
        ("generate_data.py",),
        ("-m", "msnn", "train", ARM, *settings),
        ("-m", "msnn", "validate", ARM),
        ("evaluate.py",),
        ("control.py",),
        ("-m", "msnn", "export", COMPENSATOR, "--to", "c", "--check"),
        ("-m", "msnn", "verify", "build/export/c"),
        ("series.py",),
        ("figures.py",),
        ("results.py",),
    ):
        run(command, times)
    print("\n  wall  processors")
    for shown, (wall, used) in times.items():
        print(f"{wall:4.0f} s  {used:8.0f} s  {shown}")
    return 0


def run(command: tuple[str, ...], times: dict[str, tuple[float, float]]) -> None:
    """Shows a command and runs it; what it writes goes to the terminal.

    `times` gets its seconds, and those of processors with all that it starts.
    """
    shown = " ".join(command[1:] if command[0] == "-m" else ("python", *command))
    print(f"\n$ {shown}", flush=True)
    began, used = time.perf_counter(), _processors()
    code = subprocess.run([sys.executable, *command], cwd=HERE, check=False).returncode
    if code not in (0, 3):  # 3: a limit is broken, and the table has said so
        raise SystemExit(code)
    times[shown] = (time.perf_counter() - began, _processors() - used)


def _processors() -> float:
    """Seconds that processes used which have ended."""
    now = os.times()
    return now.children_user + now.children_system


if __name__ == "__main__":
    raise SystemExit(main())

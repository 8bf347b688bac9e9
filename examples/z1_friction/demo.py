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

import results

HERE = Path(__file__).resolve().parent
ARM, COMPENSATOR = "z1_friction.msnn.yaml", "compensator.msnn.yaml"
LIMIT_BROKEN = 3  # what `msnn validate` ends with where a limit of the spec does not hold


def main() -> int:
    """Run the commands in the example's folder; ends with the exit code of the first that fails.

    A broken limit of the spec is told at once and in the end, whose exit code is then 3.
    """
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--set", action="append", default=[], help="passed on to `msnn train`")
    settings = [word for value in parser.parse_args().set for word in ("--set", value)]
    times: dict[str, tuple[float, float]] = {}
    limits_hold = True
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
    ):
        limits_hold &= run(command, times)
    seconds = {shown: used for shown, (_, used) in times.items()}
    results.keep("seconds", {**seconds, "together": sum(seconds.values())})
    run(("results.py",), times)
    print("\n  wall  processors")
    for shown, (wall, used) in times.items():
        print(f"{wall:4.0f} s  {used:8.0f} s  {shown}")
    if not limits_hold:
        print(f"a limit of {ARM} is broken: see `msnn validate` above")
    return 0 if limits_hold else LIMIT_BROKEN


def run(command: tuple[str, ...], times: dict[str, tuple[float, float]]) -> bool:
    """Shows a command and runs it; what it writes goes to the terminal. False for a broken limit.

    Only `msnn validate` may find one, and goes on. `times` gets the command's seconds, and those of
    processors with all that it starts.
    """
    shown = " ".join(command[1:] if command[0] == "-m" else ("python", *command))
    print(f"\n$ {shown}", flush=True)
    began, used = time.perf_counter(), _processors()
    code = subprocess.run([sys.executable, *command], cwd=HERE, check=False).returncode
    broken = code == LIMIT_BROKEN and command[:3] == ("-m", "msnn", "validate")
    if code and not broken:
        raise SystemExit(code)
    if broken:
        print("a limit is broken: what follows is done and measured all the same", flush=True)
    times[shown] = (time.perf_counter() - began, _processors() - used)
    return not broken


def _processors() -> float:
    """Seconds that processes used which have ended."""
    now = os.times()
    return now.children_user + now.children_system


if __name__ == "__main__":
    raise SystemExit(main())

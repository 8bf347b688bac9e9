"""Records the rig, trains the model, generates the controller and closes the loop.

What a user types is done by the commands themselves; each is shown before it runs. The numbers go
to `results.json` and README, the figure to `figures/`.
"""

import argparse
import subprocess
import sys
import time
from pathlib import Path

import closed_loop
import record
import results

import msnn

HERE = Path(__file__).resolve().parent
LIMIT_BROKEN = 3  # what `msnn validate` ends with where a limit of the spec does not hold
SEED = 11  # of the noise in closed loop; PI is tuned with another


def main() -> int:
    """Everything, in the example's folder; 3 where a limit of the spec is broken."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    began = time.perf_counter()
    print("recording the rig", flush=True)
    record.record(HERE / "data")
    command_line("train", "tank.msnn.yaml")
    limits_hold = command_line("validate", "tank.msnn.yaml")
    command_line("export", "tank.msnn.yaml", "--check")
    model = msnn.load(HERE / "tank.msnn.yaml")
    trained = HERE / "runs" / "tank" / "latest"
    print(f"\n{results.write(judged(model, trained), HERE)}")
    print(f"\n{time.perf_counter() - began:.0f} s in all")
    if not limits_hold:
        print("a limit of tank.msnn.yaml is broken: see `msnn validate` above")
    return 0 if limits_hold else LIMIT_BROKEN


def judged(model: msnn.Model, trained: Path) -> results.Judged:
    """Both controllers on the rig."""
    print("closing the loop", flush=True)
    gain, rate = closed_loop.tuned(SEED + 1)
    mpc = closed_loop.Mpc(model, trained, rival=True)
    runs = {
        "mpc": closed_loop.run(mpc, SEED),
        "now": closed_loop.run(closed_loop.Mpc(model, trained, sees_ahead=False), SEED),
        "pi": closed_loop.run(closed_loop.Pi(gain, rate, bias=3.0), SEED),
    }
    return results.Judged(runs, mpc, (gain, rate))


def command_line(*arguments: str) -> bool:
    """Runs a command; ends the demo with its exit code when it failed. False for a broken limit.

    Only `msnn validate` may find one, and what follows is done all the same.
    """
    print(f"\n$ msnn {' '.join(arguments)}", flush=True)
    done = subprocess.run([sys.executable, "-m", "msnn", *arguments], cwd=HERE, check=False)
    broken = done.returncode == LIMIT_BROKEN and arguments[0] == "validate"
    if done.returncode and not broken:
        raise SystemExit(done.returncode)
    if broken:
        print("a limit is broken: what follows is done and measured all the same", flush=True)
    return not broken


if __name__ == "__main__":
    raise SystemExit(main())

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
SEED = 11  # of the noise in closed loop; PI is tuned with another


def main() -> int:
    """Everything, in the example's folder."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    began = time.perf_counter()
    print("recording the rig", flush=True)
    record.record(HERE / "data")
    for command in ("train", "validate"):
        command_line(command, "tank.msnn.yaml")
    command_line("export", "tank.msnn.yaml", "--check")
    model = msnn.load(HERE / "tank.msnn.yaml")
    trained = HERE / "runs" / "tank" / "latest"
    print(f"\n{results.write(judged(model, trained), HERE)}")
    print(f"\n{time.perf_counter() - began:.0f} s in all")
    return 0


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


def command_line(*arguments: str) -> None:
    """Runs a command; ends the demo with its exit code when it failed."""
    print(f"\n$ msnn {' '.join(arguments)}", flush=True)
    done = subprocess.run([sys.executable, "-m", "msnn", *arguments], cwd=HERE, check=False)
    if done.returncode not in (0, 3):  # 3: a limit is broken, and the table has said so
        raise SystemExit(done.returncode)


if __name__ == "__main__":
    raise SystemExit(main())

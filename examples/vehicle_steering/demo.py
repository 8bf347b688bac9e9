"""Records drives, trains vehicle and controllers, exports, and drives the C on the car.

What a user types is done by the commands themselves; each is shown before it runs. The numbers go
to `results.json` and README, the figures to `figures/`.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import figures
import judge
import results
import telemetry

HERE = Path(__file__).resolve().parent
BOARD = ("arm-none-eabi-gcc", "qemu-system-arm")
LIMIT_BROKEN = 3  # what `msnn validate` ends with where a limit of the spec does not hold


def main() -> int:
    """Everything, in the example's folder; ends with the exit code of the first that fails.

    A broken limit of a spec is told at once and in the end, whose exit code is then 3.
    """
    parser = argparse.ArgumentParser(description=__doc__)
    parser.parse_args()
    began = time.perf_counter()
    print("recording drives", flush=True)
    telemetry.record(HERE / "data")
    broken: list[str] = []
    for spec in ("vehicle.msnn.yaml", "controller.msnn.yaml", "mlp.msnn.yaml"):
        msnn("train", spec)  # both controllers take the vehicle's weights
        if not limits_hold(spec):
            broken.append(spec)
    msnn("export", "vehicle.msnn.yaml", "--check")  # the predictive controller
    exported = json.loads(msnn("export", "controller.msnn.yaml", "--check", "--format", "json"))
    print("driving on the test road", flush=True)
    judged = judge.judge(HERE)
    figures.write(judged, HERE)
    found = results.numbers(judged, {"bits": bits(exported), "board": on_board()})
    results.write(found, HERE)
    took, used = time.perf_counter() - began, sum(os.times()[:4])
    print(f"\n{results.tables(found)}\n\n{took:.0f} s in all, {used:.0f} s of processors")
    if broken:
        print(f"limits are broken of {', '.join(broken)}: see `msnn validate` above")
    return LIMIT_BROKEN if broken else 0


def bits(exported: dict[str, Any]) -> int:
    """Differing bits of the C, along the record that the export was compared on."""
    targets = {target["target"]: target for target in exported["agreement"]["targets"]}
    return targets["c"]["bits"]


def on_board() -> dict[str, Any] | None:
    """What a step costs on a Cortex-M4F in QEMU at -O2; None where the tools are missing."""
    if not all(map(shutil.which, BOARD)):
        print(f"no figures of a board: {' and '.join(BOARD)} are not installed")
        return None
    report = json.loads(msnn("verify", "build/export/c", "--targets", "m4", "--format", "json"))
    figures = [figure for check in report["results"] for figure in check["figures"]]
    return next(figure for figure in figures if figure["flags"] == "-O2")


def limits_hold(spec: str) -> bool:
    """Validates a spec; a broken limit is told, and does not end the demo."""
    done = _run("validate", spec)
    print(done.stdout)
    if done.returncode not in (0, LIMIT_BROKEN):
        raise SystemExit(done.returncode)
    if done.returncode == LIMIT_BROKEN:
        print(f"a limit of {spec} is broken: what follows is done and measured all the same")
    return done.returncode == 0


def msnn(*arguments: str) -> str:
    """What a command says; ends the demo with its exit code when it failed."""
    done = _run(*arguments)
    if "json" not in arguments or done.returncode:
        print(done.stdout)
    if done.returncode:
        raise SystemExit(done.returncode)
    return done.stdout


def _run(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Shows a command and runs it."""
    print(f"\n$ msnn {' '.join(arguments)}", flush=True)
    command = [sys.executable, "-m", "msnn", *arguments]
    return subprocess.run(command, cwd=HERE, stdout=subprocess.PIPE, text=True, check=False)


if __name__ == "__main__":
    raise SystemExit(main())

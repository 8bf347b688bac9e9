"""Make the example's data, train both models, export every target, and say how it all turned out.

Everything is done by the commands that a user types; each is shown before it runs.
"""

import argparse
import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
FIR, PHYSICAL = "msd.msnn.yaml", "msd_physical.msnn.yaml"
TRUTH = {"mass": (2.0, "kg"), "damping": (1.5, "N*s/m"), "stiffness": (12.0, "N/m")}


@dataclass(frozen=True)
class Story:
    """What the commands said of one model."""

    name: str
    metrics: list[dict[str, Any]]
    parameters: dict[str, float]
    files: dict[str, list[str]]
    targets: list[dict[str, Any]]


def main() -> int:
    """Run the commands in the example's folder; 1 when one of them failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--set", action="append", default=[], help="passed on to `msnn train`")
    settings = [word for value in parser.parse_args().set for word in ("--set", value)]
    run([sys.executable, "generate_data.py"])
    stories = [tell(spec, settings) for spec in (FIR, PHYSICAL)]
    print(f"\n{summary(stories)}")
    return 0 if all(target["agrees"] for story in stories for target in story.targets) else 1


def tell(spec: str, settings: list[str]) -> Story:
    """Train, measure and export one spec."""
    trained = msnn("train", spec, *settings)
    measured = msnn("validate", spec)
    exported = msnn("export", spec, "--to", "all", "--check")
    parameters = {p["name"]: p["values"][0] for p in trained["parameters"] if p["name"] in TRUTH}
    agreement = exported["agreement"]["targets"]
    return Story(spec, measured["metrics"], parameters, exported["files"], agreement)


def msnn(verb: str, *arguments: str) -> dict[str, Any]:
    """The answer of a command as data; its progress goes to the terminal."""
    print(f"\n$ msnn {verb} {' '.join(arguments)}", flush=True)
    command = [sys.executable, "-m", "msnn", verb, *arguments, "--format", "json"]
    return json.loads(run(command))


def run(command: list[str]) -> str:
    """What a command wrote to stdout; ends the demo with its exit code when it failed."""
    done = subprocess.run(command, cwd=HERE, stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode not in (0, 3):  # 3: a limit is broken; the summary shows it
        sys.stderr.write(done.stdout)
        raise SystemExit(done.returncode)
    return done.stdout


def summary(stories: list[Story]) -> str:
    """The short table at the end."""
    lines = ["fit on the test episodes"]
    for story in stories:
        for metric in story.metrics:
            horizon = "one step" if metric["horizon"] == "1" else f"{metric['horizon']} steps"
            limit = "kept" if metric["passed"] else "BROKEN"
            lines.append(
                f"  {story.name:24} {metric['of']} {metric['metric']} {horizon:9} "
                f"{1000 * metric['value']:8.3f} mm   limit {1000 * metric['max']:g} mm {limit}"
            )
    lines.append("learned coefficients")
    for story in stories:
        for name, value in story.parameters.items():
            true, unit = TRUTH[name]
            lines.append(
                f"  {name:10} {value:9.4f} {unit:6} true {true:g}, off by "
                f"{100 * (value / true - 1):+.2f} %"
            )
    lines.append("targets written, and their worst deviation from the interpreter")
    for story in stories:
        for target in story.targets:
            name, bits = target["target"], target["bits"]
            same = "" if bits is None else f", {bits} differing bits"
            lines.append(
                f"  {story.name:24} {name:7} {len(story.files[name]):2} files, {target['dtype']}, "
                f"one step {target['one_step']:.1e}{same}"
            )
    return "\n".join(lines)


if __name__ == "__main__":
    raise SystemExit(main())

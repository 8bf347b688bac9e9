"""Chooses a structure for the drone arm by `msnn compare`, without looking at the test blocks.

    python benchmarks/quarter_drone/choose.py --data FOLDER

For each record the candidates are trained on two of the blocks 1, 3, 5 and measured on the third,
in turn. The one with the least mean error is trained on all three and simulated over blocks 2
and 4, which nothing before has read.
"""

from __future__ import annotations

import argparse
import json
import shutil
import statistics
import subprocess
import sys
import tempfile
from math import degrees
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from benchmarks.quarter_drone.protocol import HERE, RECORDS, score
from benchmarks.quarter_drone.run import DATA

BLOCKS = (1, 3, 5)
_ARM = "drone_arm.msnn.yaml"
_LAG = (
    ("  q_hang:   ", "  tau:      {init: 0.1,  min: 0.01, scale: 0.1, unit: s}\n  q_hang:   "),
    (
        "  u_1: {unit",
        '  motor: {unit: "1", der: (u_motor - motor) / tau, init: u.meas}\n  u_1: {unit',
    ),
    ("thrust * u_motor**2", "thrust * motor**2"),
)  # fmt: skip
_RAW = (("median(u, u_1, u_2)", "u"),)
_LINEAR = (("unit: 1/rad}", "unit: 1/s}"), ("drag * dq * abs(dq)", "drag * dq"))
_OFFSET = (
    ("  q_hang:   ", "  u_zero:   {init: 1,    scale: 10}\n  q_hang:   "),
    ("thrust * u_motor**2", "thrust * (u_motor - u_zero) * abs(u_motor - u_zero)"),
)
CANDIDATES: dict[str, tuple[str, tuple[tuple[str, str], ...]]] = {
    "textbook": ("drone_physics.msnn.yaml", ()),
    "arm": (_ARM, ()),
    "arm_raw": (_ARM, _RAW),
    "arm_linear_drag": (_ARM, _LINEAR),
    "arm_lag": (_ARM, _LAG),
    "arm_lag_linear": (_ARM, (*_LAG, *_LINEAR)),
    "arm_lag_raw": (_ARM, (*_LAG, *_RAW)),
    "arm_offset": (_ARM, _OFFSET),
}
"""A spec, and what is replaced in its text."""


def main() -> None:
    """Prints the errors of every candidate on the blocks held out, and the chosen one's on 2, 4."""
    parser = argparse.ArgumentParser(description="Choose a model of the quarter-drone rig.")
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--records", nargs="*", choices=RECORDS, default=list(RECORDS))
    chosen = parser.parse_args()
    data = chosen.data
    for name in chosen.records:
        file = RECORDS[name]
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place)
            shutil.copy(data / file, folder / "record.csv")
            specs = [written(candidate, folder) for candidate in CANDIDATES]
            found = {spec.name.split(".")[0]: 0.0 for spec in specs}
            errors = [held_out(specs, folder, block) for block in BLOCKS]
            found = {each: statistics.mean(e[each] for e in errors) for each in found}
            best = min(found, key=lambda each: found[each])
            shown = ", ".join(f"{each} {value:.2f}" for each, value in found.items())
            spec = folder / f"{best}.msnn.yaml"
            with tempfile.TemporaryDirectory() as empty:
                tested = score(spec, data / file, Path(empty))
            print(f"{name}: {shown}\n  chosen {best}: {tested.degrees:.3f} deg", flush=True)


def written(candidate: str, folder: Path) -> Path:
    """The spec of a candidate."""
    source, changes = CANDIDATES[candidate]
    text = (HERE / source).read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text, (candidate, old)
        text = text.replace(old, new)
    file = folder / f"{candidate}.msnn.yaml"
    file.write_text(text, encoding="utf-8")
    return file


def held_out(specs: list[Path], folder: Path, block: int) -> dict[str, float]:
    """The error in degrees on one block, of what is trained on the two others."""
    trained = [each for each in BLOCKS if each != block]
    split = f"data.split={{by: block, blocks: 5, train: {trained}, val: [{block}]}}"
    command = [sys.executable, "-m", "msnn", "compare", *[spec.name for spec in specs]]
    command += ["--set", split, "--by", "q_next.rmse", "--no-cost", "--jobs", "1"]
    done = subprocess.run(
        [*command, "--format", "json"], cwd=folder, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise RuntimeError(done.stderr)
    entries = json.loads(done.stdout)["models"]
    return {each["model"]: degrees(each["score"]) for each in entries}


if __name__ == "__main__":
    main()

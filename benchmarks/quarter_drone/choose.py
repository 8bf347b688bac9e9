"""Chooses a structure for the drone arm by `msnn compare`, without looking at the test blocks.

    python benchmarks/quarter_drone/choose.py --data FOLDER

For each record the candidates are trained on two of the blocks 1, 3, 5 and measured on the third,
in turn. One rig made all records, so one structure is chosen for them: that with the least mean of
all errors. Its parameters are trained for each record by itself, on its three blocks, and simulated
over blocks 2 and 4, which nothing before has read.
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
_BEARING = "drone_bearing.msnn.yaml"
_HANG = (
    ("  rough:    ", "  q_hang:   {init: 0, scale: 0.1, unit: rad}\n  rough:    "),
    ("sin(q) - cable", "sin(q - q_hang) - cable"),
)
_NO_CABLE = (
    ("  cable:    {init: 0, scale: 1, unit: 1/s^2, doc: torque per angle}\n", ""),
    ("  pull:     {expr: l2(cable), weight: 1.2e-4}\n", ""),
    (" - cable * q", ""),
)
_LINE = (("between: hold", "between: linear"),)
_DELAY = (
    ("  t_motor: {value: 0.05, unit: s}         # the propeller follows its command\n", ""),
    ("median(u_1, u, u[t+1])", "median(u_2, u_1, u)"),
    ("thrust * motor**2", "thrust * u_spun**2"),
    (
        'motor: {unit: "1", der: (u_spun - motor) / t_motor, init',
        'u_2: {unit: "1", next: u_1, init',
    ),
)
_TIGHT = "drone_tight.msnn.yaml"
_AT_REST = (
    ("  dq_0:     {init: 0, scale: 0.3, unit: rad/s, doc: speed at the first sample}\n", ""),
    ("init: dq_0", "init: 0"),
    ("  begin:    {expr: l2(dq_0), weight: 1e-4}\n", ""),
)
_ALIKE = (
    ("t_up:    {value: 0.03", "t_up:    {value: 0.05"),
    ("t_down:  {value: 0.08", "t_down:  {value: 0.05"),
)
_EVEN = (
    ("t_up:    {value: 0.03", "t_up:    {value: 0.04"),
    ("t_down:  {value: 0.08", "t_down:  {value: 0.07"),
)
_LATE = (
    ("  t_up:    {value: 0.03, unit: s}         # the propeller follows a larger command\n", ""),
    ("  t_down:  {value: 0.08, unit: s}         # nobody brakes it\n", ""),
    ("  t_motor: where(abs(u_spun) > abs(motor), t_up, t_down)\n", ""),
    ("median(u_1, u, u[t+1])", "median(u_2, u_1, u)"),
    ("thrust * motor**2", "thrust * u_spun**2"),
    (
        'motor: {unit: "1", der: (u_spun - motor) / t_motor, init',
        'u_2: {unit: "1", next: u_1, init',
    ),
)
_LOWER = (("value: 3.5", "value: 3"), ("value: 1.2217", "value: 1.1868"), ("70 deg", "68 deg"))
CANDIDATES: dict[str, tuple[str, tuple[tuple[str, str], ...]]] = {
    "textbook": ("drone_physics.msnn.yaml", ()),
    "arm": (_ARM, ()),
    "arm_raw": (_ARM, _RAW),
    "arm_line": (_ARM, _LINE),
    "arm_linear_drag": (_ARM, _LINEAR),
    "arm_lag": (_ARM, _LAG),
    "arm_lag_linear": (_ARM, (*_LAG, *_LINEAR)),
    "arm_lag_raw": (_ARM, (*_LAG, *_RAW)),
    "arm_offset": (_ARM, _OFFSET),
    "bearing": (_BEARING, ()),
    "bearing_smooth": (_BEARING, (("weight: 0.007", "weight: 0.02"),)),
    "bearing_rough": (_BEARING, (("weight: 0.007", "weight: 0.003"),)),
    "bearing_hang": (_BEARING, _HANG),
    "bearing_free": (_BEARING, _NO_CABLE),
    "bearing_line": (_BEARING, _LINE),
    "bearing_quick": (_BEARING, (("t_motor: {value: 0.05", "t_motor: {value: 0.03"),)),
    "bearing_slow": (_BEARING, (("t_motor: {value: 0.05", "t_motor: {value: 0.08"),)),
    "bearing_delay": (_BEARING, _DELAY),
    "tight": (_TIGHT, ()),
    "tight_rest": (_TIGHT, _AT_REST),
    "tight_alike": (_TIGHT, _ALIKE),
    "tight_delay": (_TIGHT, _LATE),
    "tight_delay_rest": (_TIGHT, (*_LATE, *_AT_REST)),
    "tight_lower": (_TIGHT, _LOWER),
    "tight_quick": (_TIGHT, (("t_down:  {value: 0.08", "t_down:  {value: 0.06"),)),
    "tight_even": (_TIGHT, _EVEN),
}
"""A spec, and what is replaced in its text."""


def main() -> None:
    """Prints the errors of every candidate on held-out blocks, and those of the chosen one on
    blocks 2 and 4.
    """
    parser = argparse.ArgumentParser(description="Choose a model of the quarter-drone rig.")
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--candidates", nargs="*", choices=CANDIDATES, default=list(CANDIDATES))
    chosen = parser.parse_args()
    data: Path = chosen.data
    found: dict[str, list[float]] = {name: [] for name in chosen.candidates}
    print("| candidate | " + " | ".join(RECORDS) + " | mean |")
    print("|---|" + "---|" * (len(RECORDS) + 1))
    for file in RECORDS.values():
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place)
            shutil.copy(data / file, folder / "record.csv")
            specs = [written(candidate, folder) for candidate in found]
            errors = [held_out(specs, folder, block) for block in BLOCKS]
            for name, of_records in found.items():
                of_records.append(statistics.mean(each[name] for each in errors))
    for name, of_records in found.items():
        cells = " | ".join(f"{error:.2f}" for error in of_records)
        print(f"| {name} | {cells} | {statistics.mean(of_records):.2f} |")
    best = min(found, key=lambda name: statistics.mean(found[name]))
    tested: list[str] = []
    for file in RECORDS.values():
        with tempfile.TemporaryDirectory() as place, tempfile.TemporaryDirectory() as empty:
            tested.append(
                f"{score(written(best, Path(place)), data / file, Path(empty)).degrees:.3f}"
            )
    print(f"\nchosen: {best}; on blocks 2 and 4: {', '.join(tested)} deg")


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
    """The error in degrees on one block, after training on the other two."""
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

"""Compares the C of msnn with that of its rivals on the gallery's reference model, in one run.

Counts instructions of a step on a Cortex-M4F in QEMU, bytes of flash, RAM and stack, and measures
nanoseconds a step here. Needs arm-none-eabi-gcc and qemu-system-arm; the environment of
emx-onnx-cgen is made where it is first needed, in the folder that MSNN_PEERS names.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "training"))

from board import OnBoard, measured
from contenders import Contender, contenders, onnx_file
from environments import peer_python
from host import host_nanoseconds, onnxruntime_nanoseconds


def main() -> None:
    emx = peer_python("emx", Path(__file__).parent / "peers").parent / "emx-onnx-cgen"
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        rows = [
            (contender, measured(contender, contender.folder), host_nanoseconds(contender, folder))
            for contender in contenders(folder, emx)
        ]
        print(_table(rows), "", _verdict(rows), sep="\n")
        calls = onnxruntime_nanoseconds(onnx_file(folder))
        print(f"\nonnxruntime, called from Python: {calls:.0f} ns a step")


Row = tuple[Contender, list[OnBoard], float]


def _table(rows: list[Row]) -> str:
    """A table with each tool at the levels with fewest instructions and with least flash."""
    head = ["tool", "level", "instructions (least, most)", "flash", "RAM", ".data", "stack"]
    lines = [[*head, "ns here", "largest difference"]]
    reference = rows[0][1][0].outputs.astype(float)
    for contender, levels, nanoseconds in rows:
        fastest, smallest = (_best(levels, by) for by in ("mean", "flash"))
        for found in dict.fromkeys(map(levels.index, (fastest, smallest))):
            row = levels[found]
            difference = np.abs(row.outputs.astype(float) - reference).max()
            sizes = [str(n) for n in (row.flash, row.ram, row.data, row.stack)]
            count = f"{row.mean:.1f} ({row.least}, {row.most})"
            shown = f"{nanoseconds:.1f}" if row is fastest else ""
            lines.append([contender.name, row.level, count, *sizes, shown, f"{difference:.1e}"])
    return "\n".join("| " + " | ".join(line) + " |" for line in _ruled(lines))


def _best(levels: list[OnBoard], by: str) -> OnBoard:
    return min(levels, key=lambda row: getattr(row, by))


def _ruled(lines: list[list[str]]) -> list[list[str]]:
    return [lines[0], ["---"] * len(lines[0]), *lines[1:]]


def _verdict(rows: list[Row]) -> str:
    """Text with the ratio of msnn's code to the best other one, with manual corrections and
    without.
    """
    rivals = [(_best(found, "mean").mean, c) for c, found, _ in rows if not c.own]
    lines: list[str] = []
    for kind, chosen in (
        ("any rival", rivals),
        ("a rival as it comes", [(mean, c) for mean, c in rivals if not c.flags]),
    ):
        least, best = min(chosen, key=lambda rival: rival[0])
        shares = [
            f"{c.name} {_best(found, 'mean').mean / least:.2f}" for c, found, _ in rows if c.own
        ]
        lines.append(f"Of the fewest instructions of {kind} ({best.name}): {'; '.join(shares)}.")
    return "\n\n".join(lines)


if __name__ == "__main__":
    main()

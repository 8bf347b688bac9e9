"""Computes from RESULTS.md what larger sweeps and data would take: `cost_model.py --write`.

Nothing is measured here. N trainings of t seconds on W processors take N · max(t / W, s), where s
is what the command itself does for a training on Ray: so many workers, t / s, it keeps busy. A
terabyte of files as `rows_on_disk.py` writes them takes as many times what these took as it is
larger. Run it after the others; docs/scale.md has these figures.
"""

from __future__ import annotations

import argparse
import re
from statistics import median

from results import FILE, write_section

TERABYTE = 1e12
TRAININGS = (0.05, 1.0, 10.0)
"""Seconds of a training."""


def main() -> None:
    """Reads the measurements, computes, and prints the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="keep the figures")
    given = parser.parse_args()
    text = FILE.read_text(encoding="utf-8")
    lines = [*sweeps(text), *terabyte(text)]
    print(*lines, sep="\n")
    if given.write:
        write_section("cost_model.py", lines)


def sweeps(text: str) -> list[str]:
    """Lines that say how many workers one command keeps busy."""
    command = median(found(r"on Ray: ([\d.]+) ms in this process", text))
    return [
        f"the command needs {command:.1f} ms of CPU a training",
        *(f"trainings of {each:g} s: {1e3 * each / command:.0f} workers" for each in TRAININGS),
    ]


def terabyte(text: str) -> list[str]:
    """Lines that extrapolate the training on 10⁸ rows to a terabyte."""
    (rows,) = found(r"([\d,]+) rows written", text)
    (size,) = found(r"rows written in .*?, ([\d.]+) GB", text)
    times = TERABYTE / (size * 1e9)
    first, second, third, *_ = found(r"^ *([\d.]+) s  (?:StageStart|EpochEnd)", text)
    all_rows, epoch = times * rows, third - second
    each = size * 1e9 / rows
    return [
        f"1 TB is {times:.0f} times as much: {all_rows:.1e} rows, {each:.1f} bytes a row",
        f"to the first epoch {first:.0f} s, for 1 TB {times * first / 3600:.0f} hours",
        f"an epoch {epoch:.1f} s, for 1 TB {times * epoch / 3600:.1f} hours",
        f"read by one command: {size * 1e3 / first:.1f} MB/s",
        f"16 bytes a row: {16 * all_rows / 1e12:.1f} TB, 24: {24 * all_rows / 1e12:.1f} TB",
    ]


def found(pattern: str, text: str) -> list[float]:
    """The numbers at all matches of a pattern."""
    numbers = re.findall(pattern, text, flags=re.MULTILINE)
    return [float(number.replace(",", "")) for number in numbers]


if __name__ == "__main__":
    main()

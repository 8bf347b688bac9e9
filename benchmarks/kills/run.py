"""Kills trainings, trainings of folds and exports at random moments, by SIGKILL, SIGTERM, SIGINT.

`run.py [COUNT [SEED [MOST_LOST [EPOCHS]]]]`. Case n has the seed SEED + n and is the same in every
call, so that a run of many is divided into several. Prints a line a case and a table, of what was
done where Ctrl-C ends it: kills, seconds of work lost at most, how many cases became to the bit
what nobody disturbed. Exit code 1 where one did not, or lost more than MOST_LOST.
Undisturbed trainings shall be some times longer than MOST_LOST: EPOCHS makes them so.
"""

from __future__ import annotations

import sys
import tempfile
from contextlib import suppress
from pathlib import Path

from benchmarks.kills.cases import Outcome, killed, subjects
from msnn.tables import table_text


def main() -> int:
    given = sys.argv[1:]
    count, seed = (int(text) for text in (*given[:2], *("30", "0")[len(given[:2]) :]))
    most_lost = float(given[2]) if len(given) > 2 else 1.0
    epochs = int(given[3]) if len(given) > 3 else 1000
    outcomes: list[Outcome] = []
    with tempfile.TemporaryDirectory() as place:
        found = subjects(Path(place), epochs, most_lost)
        for each in found.values():
            print(f"{each.kind}: {each.seconds:.1f} s undisturbed", flush=True)
        kinds = tuple(found)
        with suppress(KeyboardInterrupt):
            for number in range(seed, seed + count):
                subject = found[kinds[number % len(kinds)]]
                outcome = killed(subject, Path(place) / f"case_{number}", number)
                outcomes.append(outcome)
                said = f"{outcome.kind}, {outcome.kills} kills, {outcome.lost:.1f} s lost"
                print(
                    f"seed {number}: {said if outcome.is_good(most_lost) else outcome}", flush=True
                )
    rows = [
        (
            kind,
            str(len(own)),
            str(sum(each.kills for each in own)),
            f"{max((each.lost for each in own), default=0.0):.2f}",
            str(sum(each.right for each in own)),
            str(sum(each.latest_stayed for each in own)),
        )
        for kind in kinds
        if (own := [each for each in outcomes if each.kind == kind])
    ]
    header = ("", "cases", "kills", "seconds lost", "same bits", "latest stayed")
    print(table_text(header, rows, numbers=range(1, 6)))
    return 0 if all(each.is_good(most_lost) for each in outcomes) else 1


if __name__ == "__main__":
    raise SystemExit(main())

"""Saves the models that nnodely's own tests make, and what it predicts with each of them."""

from __future__ import annotations

import contextlib
import json
import logging
import os
import sys
import unittest
from pathlib import Path

from nnodely import Modely
from worker import predicted

_seen: set[str] = set()
_count: dict[str, int] = {}


def main() -> None:
    tests, folder = Path(sys.argv[1]), Path(sys.argv[2])
    folder.mkdir(parents=True, exist_ok=True)
    current = {"name": "loaded"}
    build = Modely.neuralizeModel
    said = sys.stdout

    def neuralize(m: Modely, *arguments: object, **named: object) -> None:
        build(m, *arguments, **named)
        try:
            keep(m, current["name"], folder)
        except Exception as fault:  # noqa: BLE001  (nnodely fails in many ways)
            print(f"{current['name']}: nnodely fails: {type(fault).__name__}: {fault}", file=said)

    Modely.neuralizeModel = neuralize
    os.chdir(tests)
    sys.path.insert(0, str(tests))
    for file in sorted(tests.glob("test_*.py")):
        try:
            found = unittest.defaultTestLoader.loadTestsFromName(file.stem)
        except Exception as fault:  # noqa: BLE001  (some need packages that nnodely does not ask for)
            print(f"{file.stem}: {type(fault).__name__}: {fault}")
            continue
        for test in each(found):
            current["name"] = f"suite_{file.stem.removeprefix('test_')}_{test.id().split('.')[-1]}"
            with Path(os.devnull).open("w") as nowhere, contextlib.redirect_stdout(nowhere):
                test.run(unittest.TestResult())


def each(suite: unittest.TestSuite):
    for one in suite:
        if isinstance(one, unittest.TestSuite):
            yield from each(one)
        else:
            yield one


def keep(m: Modely, name: str, folder: Path) -> None:
    """Saves the current model, unless an equal one is already saved."""
    kept = predicted(m, name, begins_loops=False)
    if isinstance(kept, str):
        raise ValueError(kept)
    if kept["model"] in _seen:
        return
    _seen.add(kept["model"])
    _count[name] = number = _count.get(name, 0) + 1
    (folder / f"{name}_{number}.json").write_text(json.dumps(kept))


if __name__ == "__main__":
    logging.disable(logging.CRITICAL)
    main()

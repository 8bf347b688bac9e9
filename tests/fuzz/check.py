"""Checks spoiled specs for as long as is wanted; prints what ends in anything but a diagnostic.

    python -m tests.fuzz.check --seconds 300 --first 0

A crash is written once for each place in the code it comes from, with the seed that repeats it.
"""

from __future__ import annotations

import argparse
import resource
import signal
import time
import traceback
import warnings
from contextlib import suppress
from pathlib import Path
from types import FrameType

from compiler.elaboration.compile import compile_spec
from msnn.reports.diagram.mermaid import mermaid_text
from msnn.reports.latex import latex_text
from msnn.reports.show import interface_text, windows_text
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.diagnostics.render import Format, render
from spec_schema.editors.format_spec import format_spec
from spec_schema.editors.spec_data import spec_data
from spec_schema.reading.reader import read_spec
from spec_schema.yaml_tree.writer import yaml_text
from tests.fuzz.mutations import spoiled

ROOT = Path(__file__).parents[2]
FORMATS: tuple[Format, ...] = ("full", "concise", "json", "github", "sarif")
GIBIBYTES = 4
LONGEST = 20
"""Seconds in which every spec must be answered, however slow the machine."""


def specs() -> tuple[str, ...]:
    """Every good spec of the repository that is small enough to be compiled often."""
    places = (
        "tests/spec_schema/good",
        "tests/language",
        "tests/golden",
        "examples",
        "tests/bad_specs",
    )
    files = sorted(file for place in places for file in (ROOT / place).rglob("*.yaml"))
    # what somebody has trained in an example is no part of the repository
    own = [file for file in files if "runs" not in file.relative_to(ROOT).parts]
    texts = [file.read_bytes().decode(errors="replace") for file in own]
    return tuple(text for text in texts if len(text) < 6000)


def answer(text: str) -> None:
    """What `check`, `show` and `fmt` say of a spec; a diagnostic is an answer too."""
    path = ROOT / "tests" / "bad_specs" / "spoiled.yaml"
    for verb in (_check, _format):
        try:
            verb(path, text)
        except SpecError as error:
            for form in FORMATS:
                render(error.diagnostics, form, error.sources)


def _check(path: Path, text: str) -> None:
    found = read_spec(path, text)
    try:
        program = compile_spec(found.spec, used=found.used).program
    except SpecError as error:
        raise SpecError(error.diagnostics, found.sources) from None
    mermaid_text(found.spec)
    latex_text(found.spec)
    yaml_text(spec_data(found.spec))
    interface_text(program)
    windows_text(program)


def _format(path: Path, text: str) -> None:
    once = format_spec(str(path), text)
    assert format_spec(str(path), once) == once


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60)
    parser.add_argument("--first", type=int, default=0)
    arguments = parser.parse_args()
    resource.setrlimit(resource.RLIMIT_AS, (GIBIBYTES << 30, GIBIBYTES << 30))
    warnings.simplefilter("error")
    signal.signal(signal.SIGALRM, _too_long)
    known: set[str] = set()
    end, seed, good = time.monotonic() + arguments.seconds, arguments.first, specs()
    while time.monotonic() < end:
        signal.alarm(LONGEST)
        try:
            answer(spoiled(seed, good))
        except Exception as error:  # noqa: BLE001  (whatever it is, it is what we look for)
            last = traceback.extract_tb(error.__traceback__)[-1]
            place = f"{type(error).__name__} {last.filename}:{last.lineno}"
            if place not in known:
                known.add(place)
                print(f"seed {seed}: {place}: {str(error)[:200]}", flush=True)
        seed += 1
    signal.alarm(0)
    print(f"{seed - arguments.first} specs, {len(known)} kinds of crash")


def _too_long(number: int, frame: FrameType | None) -> None:
    del number, frame
    raise TimeoutError(f"more than {LONGEST} s")


if __name__ == "__main__":
    with suppress(KeyboardInterrupt):
        main()

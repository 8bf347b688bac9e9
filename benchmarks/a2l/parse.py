"""Reads the ASAP2 files of exports with pya2l, a parser that is not ours.

    uv run --with pya2l --with '.[a2l]' python benchmarks/a2l/parse.py [--write] [SPEC …]

Without a spec: every spec of the gallery, in float32 and float64, with parameters of every kind,
and in fixed point where its ranges allow that. Exit code 1 where the parser has an error or a
warning. `--write` writes RESULTS.md.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any

from backends.asap2.text import a2l_text
from backends.c.folder.calibrated_model import calibrated_model
from backends.c.interface.interface import c_interface
from backends.c_lowering.options import COptions
from msnn.exports.export import plan_exports, write_export
from msnn.model.load import load_model
from msnn.model.weights.weights_file import initial_weights
from spec_schema.diagnostics.diagnostic import Findings, SpecError

GALLERY = Path(__file__).resolve().parents[2] / "examples" / "gallery"


def texts(spec: Path) -> Iterator[tuple[str, str]]:
    """Yields the ASAP2 files of a spec, each with the options of its export."""
    for settings in (
        ["dtype=float32"],
        ["dtype=float64"],
        ["dtype=float32", "params=tunable"],
        ["dtype=float32", "params=calibration"],
        ["dtype=float32", "params=inline"],
    ):
        model = load_model(spec, [f"export.c.{setting}" for setting in settings])
        (plan,) = plan_exports(model, ["c"], Findings())
        assert isinstance(plan.options, COptions)
        interface = c_interface(plan.program, plan.options)
        yield ", ".join(settings), a2l_text(calibrated_model(plan.program, interface))
    for dtype in ("q15", "q31"):
        findings = Findings()
        plans = plan_exports(load_model(spec, [f"export.c.dtype={dtype}"]), ["c"], findings)
        with tempfile.TemporaryDirectory() as folder:
            try:
                findings.raise_errors()
                (plan,) = plans
                write_export(plan, initial_weights(plan.program), Path(folder))
            except SpecError:
                continue
            (file,) = Path(folder).glob("*.a2l")
            yield f"dtype={dtype}", file.read_text(encoding="utf-8")


_TEXT = """\
# ASAP2 files read by pya2l {version}

Written by `python benchmarks/a2l/parse.py --write`: those of every spec of the gallery, in float32
and float64, with parameters of every kind, and in fixed point where its ranges allow that.

{files} files, {warnings} warnings

```text
{found}
```
"""


def main(specs: list[Path], *, is_written: bool) -> int:
    parser_of: Any = import_module("pya2l.parser").A2lParser
    found = 0
    lines: list[str] = []
    for spec in specs:
        for asked, text in texts(spec):
            with parser_of() as parser:
                tree = parser.tree_from_a2l(text.encode(), enforce_version_check=True)
                warnings = list(parser.warnings)
            module = tree.PROJECT.MODULE[0]
            counts = f"{len(module.CHARACTERISTIC)} parameters, {len(module.MEASUREMENT)} measured"
            lines.append(f"{spec.name}, {asked}: {counts}, {len(warnings)} warnings")
            print(lines[-1], *warnings, sep="\n", flush=True)
            found += len(warnings)
    if is_written:
        text = _TEXT.format(
            version=version("pya2l"), files=len(lines), warnings=found, found="\n".join(lines)
        )
        Path(__file__).with_name("RESULTS.md").write_text(text, encoding="utf-8")
    return 1 if found else 0


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Reads ASAP2 files with pya2l.")
    parser.add_argument("specs", nargs="*", type=Path, metavar="SPEC")
    parser.add_argument("--write", action="store_true", help="Write the page of results.")
    given = parser.parse_args()
    every = sorted(GALLERY.glob("*.msnn.yaml"))
    sys.exit(main(given.specs or every, is_written=given.write))

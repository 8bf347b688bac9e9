"""Makes `data:` sections out of their YAML, and data sets out of texts of files."""

from __future__ import annotations

from pathlib import Path
from textwrap import indent

from compiler.ir.program import Program
from msnn.data.dataset import Dataset
from msnn.data.reading.load import load_data
from spec_schema.reading.reader import read_spec
from spec_schema.sections.data import Data
from tests.programs import fir_closed_loop


def data_section(text: str) -> Data:
    """The section as the reader makes it from a spec that holds it."""
    spec = (
        "msnn: 1\nname: plant\nsample_time: 0.2 s\ninputs: {x: m, F: N}\n"
        "outputs: {y: {expr: x + 1}}\ndata:\n" + indent(text, "  ")
    )
    data = read_spec("plant.msnn.yaml", spec).spec.data
    assert data is not None
    return data


def load(
    folder: Path, section: str, files: dict[str, str] | None = None, program: Program | None = None
) -> Dataset:
    """The data of a section, by default for signals x [m] and F [N] every 0.2 s."""
    for name, text in (files or {}).items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, "utf-8")
    return load_data(program or fir_closed_loop().program, data_section(section), folder)


def table(rows: int, header: str = "time,x,F", step: float = 0.2) -> str:
    """A file of `rows` rows with time, x = row number and F = −row number."""
    lines = [header, *(f"{i * step:.6g},{i},{-i}" for i in range(rows))]
    return "\n".join(lines) + "\n"

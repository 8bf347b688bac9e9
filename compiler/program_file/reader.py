"""Builds a Program from the parsed data of its file."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from compiler.ir.fit import Fit
from compiler.ir.program import (
    Dimension,
    Expected,
    Formula,
    Graph,
    Loss,
    Node,
    Output,
    Parameter,
    Program,
    Signal,
    State,
    UsedPlugin,
)
from compiler.program_file.fields import Shared, read
from compiler.program_file.plain_data import PlainRecord, as_text

Made = TypeVar("Made")


def read_program(data: Any) -> Program:
    """The program in the data, not verified yet. Raises Malformed."""
    record = PlainRecord(data, "the file")
    record.integer("format")
    shared = Shared(record.items("files", as_text))

    def reading(make: type[Made]) -> Callable[[Any, str], Made]:
        return lambda item, place: read(make, item, place, shared)

    program = Program(
        name=record.text("name"),
        sample_time=record.number("sample_time") if record.has("sample_time") else None,
        signals=record.items("signals", reading(Signal)),
        parameters=record.items("parameters", reading(Parameter)),
        states=record.items("states", reading(State)),
        step=Graph(record.items("step", reading(Node))),
        start=Graph(record.items("start", reading(Node))),
        outputs=record.items("outputs", reading(Output)),
        losses=record.items("losses", reading(Loss)),
        expected=record.items("expected", reading(Expected)) if record.has("expected") else (),
        fits=record.items("fits", reading(Fit)) if record.has("fits") else (),
        dimensions=record.items("dimensions", reading(Dimension)),
        formulas=record.items("formulas", reading(Formula)) if record.has("formulas") else (),
        plugins=record.items("plugins", reading(UsedPlugin)) if record.has("plugins") else (),
        doc=record.text("doc"),
        spec_hash=record.text("spec_hash"),
    )
    # unknown keys are refused, since they may change the meaning of the program
    record.close()
    return program

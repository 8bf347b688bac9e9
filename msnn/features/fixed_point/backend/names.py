"""Names and types of generated fixed-point C."""

from __future__ import annotations

from dataclasses import dataclass

from backends.c_language.printer import Printer
from backends.ports.identifiers import c_identifier
from msnn.features.fixed_point.integers.interpret import FixedStatus
from msnn.features.fixed_point.integers.program import IntegerProgram


@dataclass(frozen=True, slots=True, kw_only=True)
class FixedNames:
    """C identifiers by the names of the spec; each dict is one struct."""

    model: str
    """Name of the program."""
    prefix: str
    inputs: dict[str, str]
    outputs: dict[str, str]
    windows: dict[str, str]
    memories: dict[str, str]
    held: dict[str, str]
    ready: str

    @property
    def macro(self) -> str:
        return self.prefix.upper()

    @property
    def takes_parameters(self) -> bool:
        """Always False: weights are constants in the code."""
        return False

    def status(self, bit: FixedStatus) -> str:
        """The macro of a status bit."""
        assert bit.name is not None
        return f"{self.macro}_STATUS_{bit.name}"


def fixed_names(program: IntegerProgram, prefix: str) -> FixedNames:
    """Chooses names that neither C nor the headers use."""
    prefix = c_identifier(prefix, set())
    # one set a struct: members of different structs may share a name in C
    ins, outs, wins, mems = (set[str]() for _ in range(4))
    # before the memories: a state that is called so gives way
    ready = c_identifier("ready", mems)
    return FixedNames(
        model=program.name,
        prefix=prefix,
        inputs={e.port.name: c_identifier(e.port.name, ins) for e in program.inputs},
        outputs={port.name: c_identifier(port.name, outs) for port, _ in program.outputs},
        windows={port.name: c_identifier(port.name, wins) for port in program.windows},
        memories={memory.name: c_identifier(memory.name, mems) for memory in program.memories},
        # held words lie in the state struct, among the memories, and so take names from their set
        held={
            e.port.name: c_identifier(f"{e.port.name}.held", mems)
            for e in program.inputs
            if e.policy == "hold"
        },
        ready=ready,
    )


def fixed_printer(program: IntegerProgram, names: FixedNames) -> Printer:
    """Prints C with the program's types."""
    sum_bits = 64 if program.width.sum == 64 else 32
    return Printer(names.prefix, sum_bits=sum_bits, places_tables=True)

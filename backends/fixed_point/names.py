"""Names and types of generated C in fixed point."""

from __future__ import annotations

from dataclasses import dataclass

from backends.identifiers import c_identifier
from compiler.fixed_point.integer_program import IntegerProgram


@dataclass(frozen=True, slots=True)
class FixedNames:
    """Identifiers by the names of the spec; each dict is one struct."""

    prefix: str
    inputs: dict[str, str]
    outputs: dict[str, str]
    windows: dict[str, str]
    memories: dict[str, str]
    held: dict[str, str]
    waiting: str

    @property
    def macro(self) -> str:
        return self.prefix.upper()


def fixed_names(program: IntegerProgram, prefix: str) -> FixedNames:
    """Names that neither C nor the headers use."""
    prefix = c_identifier(prefix, set())
    ins, outs, wins, mems = (set[str]() for _ in range(4))
    waiting = c_identifier("waiting", mems)
    return FixedNames(
        prefix,
        {e.port.name: c_identifier(e.port.name, ins) for e in program.inputs},
        {port.name: c_identifier(port.name, outs) for port, _ in program.outputs},
        {port.name: c_identifier(port.name, wins) for port in program.windows},
        {memory.name: c_identifier(memory.name, mems) for memory in program.memories},
        {
            e.port.name: c_identifier(f"{e.port.name}.held", mems)
            for e in program.inputs
            if e.policy == "hold"
        },
        waiting,
    )

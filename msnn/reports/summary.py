"""Summarises a program in one line, the last line of `msnn check`."""

from __future__ import annotations

from compiler.ir.nodes import extents
from compiler.ir.program import Declared, LayerMemory, Program, Role
from compiler.passes.simplify import prune_outputs
from msnn.tables import count


def summary_line(program: Program) -> str:
    """`mass_spring_damper: 2 inputs, 1 output, 6 parameters, a sample every 0.2 s`."""
    numbers = sum(len(parameter.initial) for parameter in program.parameters)
    inputs = [signal for signal in program.signals if signal.role is Role.INPUT]
    states = [state for state in program.states if isinstance(state.origin, Declared | LayerMemory)]
    parts = [count(len(inputs), "input"), count(len(program.outputs), "output")]
    if states:
        parts.append(count(len(states), "state"))
    parts.append(count(numbers, "parameter"))
    if program.sample_time is not None:
        parts.append(f"a sample every {program.sample_time:g} s")
    previews = _previewed(program)
    if previews:
        parts.append(f"reads the future of {', '.join(previews)}")
    return f"{program.name}: {', '.join(parts)}"


def _previewed(program: Program) -> list[str]:
    """The inputs of which the deployed part reads future samples."""
    deployed = prune_outputs(program, [output.name for output in program.outputs])
    read = extents(deployed.step, log=False)
    names = (signal.name for signal in deployed.signals if signal.role is Role.INPUT)
    return [name for name in names if name in read and read[name].last > 0]

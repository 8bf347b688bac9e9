"""Scripts for `unit_host.c`: what an importer does with a unit, along drawn inputs."""

from __future__ import annotations

import random
import re
import struct
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from tests.exports.other_machines.machines import Machine

STEPS = 30
ALONE, OTHER, TURN = 2, 1, 0
"""Instances: the first does in turn with another what the third does alone."""


class Unit(NamedTuple):
    """An archive and its description, of FMPy."""

    path: Path
    description: Any
    has_slopes: bool

    @property
    def version(self) -> int:
        return int(str(self.description.fmiVersion)[0])

    @property
    def dtype(self) -> str:
        types = {variable.type for variable in self.description.modelVariables}
        return "Float32" if "Float32" in types else "Float64"

    @property
    def every(self) -> float:
        """Seconds of a step."""
        return float(self.description.defaultExperiment.stepSize or 1.0)


def read_unit(path: Path) -> Unit:
    from fmpy import read_model_description

    with zipfile.ZipFile(path) as archive:
        # FMPy reads the name that FMI 2.0 has for it, not that of 3.0
        text = archive.read("modelDescription.xml").decode()
    has_slopes = re.search(r'providesDirectionalDerivatives?="true"', text) is not None
    return Unit(path, read_model_description(str(path)), has_slopes)


def answers(machine: Machine, host: Path, unit: Unit, folder: Path) -> list[str] | None:
    """What a unit's binary for a machine answers; None where its archive has none."""
    place = machine.platform.path(
        2 if unit.version == 2 else 3, unit.description.coSimulation.modelIdentifier
    )
    with zipfile.ZipFile(unit.path) as archive:
        if place not in archive.namelist():
            return None
        library = folder / f"{machine.platform.fmi3}.{unit.path.stem}.{machine.platform.suffix}"
        library.write_bytes(archive.read(place))
    told = machine.said(
        host,
        *(str(unit.version), unit.dtype, str(library), unit.description.guid),
        script="\n".join(script(unit)),
    )
    return told.splitlines()


def script(unit: Unit) -> Iterator[str]:
    """Two instances in turn, a state that another goes on from, slopes, refusals; one alone."""
    yield "other_token"
    for instance in (TURN, OTHER):
        yield from begun(unit, instance)
    for step in range(STEPS):
        for instance in (TURN, OTHER):
            yield from stepped(unit, instance, step, seed=instance)
    yield f"save {TURN}"
    yield f"load {OTHER}"
    for step in range(STEPS, STEPS + 10):
        for instance in (TURN, OTHER):
            yield from stepped(unit, instance, step, seed=TURN)
    yield f"step {TURN} {bits(0.0)} {bits(unit.every / 2)}"
    yield f"reset {TURN}"
    yield from begun(unit, ALONE)
    for step in range(STEPS):
        yield from stepped(unit, ALONE, step, seed=TURN)
    for instance in (TURN, OTHER, ALONE):
        yield f"free {instance}"


def begun(unit: Unit, instance: int) -> Iterator[str]:
    yield f"new {instance}"
    yield f"enter {instance}"
    for variable in unit.description.modelVariables:
        # the other one is another model
        if variable.variability == "tunable" and instance == OTHER:
            values = [1.01 * value for value in starts(variable)]
            yield f"set {instance} {variable.valueReference} {numbers(values)}"
    yield f"exit {instance}"


def stepped(unit: Unit, instance: int, step: int, seed: int) -> Iterator[str]:
    """A step, and all that can be read after it."""
    variables = unit.description.modelVariables
    drawn = random.Random(1000 * seed + step)
    for variable in variables:
        if variable.causality == "input":
            yield f"set {instance} {variable.valueReference} {numbers(draw(variable, drawn))}"
    yield f"step {instance} {bits(step * unit.every)} {bits(unit.every)}"
    for variable in variables:
        reference = variable.valueReference
        if variable.type in ("Integer", "UInt32"):
            yield f"count {instance} {reference}"
        elif variable.causality in ("output", "local"):
            yield f"get {instance} {reference} {size(variable)}"
    if unit.has_slopes:
        for output in variables:
            if output.causality == "output" and output.type not in ("Integer", "UInt32"):
                for known in variables:
                    if known.causality == "input":
                        seeds = numbers([1.0] * size(known))
                        of = f"{output.valueReference} {size(output)} {known.valueReference}"
                        yield f"slope {instance} {of} {seeds}"


def draw(variable: Any, drawn: random.Random) -> list[float]:
    """Values around the start, inside the range."""
    least, most = (None if v is None else float(v) for v in (variable.min, variable.max))
    width = 1.0 if least is None or most is None else most - least
    found: list[float] = []
    for start in starts(variable):
        value = start + 0.4 * width * drawn.uniform(-1.0, 1.0)
        value = value if least is None else max(value, least)
        found.append(value if most is None else min(value, most))
    return found


def starts(variable: Any) -> list[float]:
    words = str(variable.start or "0").split()
    return [float(word) for word in (words * size(variable) if len(words) == 1 else words)]


def size(variable: Any) -> int:
    found = 1
    for dimension in variable.dimensions:
        found *= int(dimension.start)
    return found


def numbers(values: list[float]) -> str:
    return " ".join([str(len(values)), *(bits(value) for value in values)])


def bits(value: float) -> str:
    return f"{struct.unpack('<Q', struct.pack('<d', value))[0]:016x}"


def of_instance(told: list[str], instance: int) -> list[list[str]]:
    """The numbers that an instance gave, in order, without its name."""
    return [
        words[2:]
        for words in map(str.split, told)
        if words[0] in ("get", "count", "slope") and words[1] == str(instance)
    ]

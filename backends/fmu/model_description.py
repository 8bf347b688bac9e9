"""Writes the model descriptions of FMI 2.0 and 3.0 as XML."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np

from backends.fmu.variable import (
    ITERATIONS_DOC,
    LOG_CATEGORIES,
    UnitFacts,
    Variable,
    VariableKind,
    element_names,
    is_structured,
)
from spec_schema.units.unit import BASE_SYMBOLS, Unit

_NO_XML = re.compile(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 cannot represent, not even escaped."""

Attributes = Mapping[str, str | None]


def element(name: str, attributes: Attributes) -> Element:
    """An XML element with the attributes that are not None. Characters that XML cannot represent
    are replaced.
    """
    return Element(name, _written(attributes))


def child(parent: Element, name: str, attributes: Attributes | None = None) -> Element:
    """Adds a new XML element as the last child of `parent`, and returns it. Attributes that are
    None are left out.
    """
    return SubElement(parent, name, _written(attributes or {}))


def xml_text(root: Element) -> str:
    """The XML document of an element as text, with indents. Quotes, angle brackets and line ends in
    attributes are escaped.
    """
    indent(root)
    # line ends in attributes are written as references: XML reads a bare one as a blank
    body = tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{body}\n'


def number_text(value: float) -> str:
    """The shortest text from which XML readers get exactly this value back: `2`, `0.1`, `-INF`,
    `NaN`.
    """
    number = float(value)
    if not np.isfinite(number):
        return "NaN" if np.isnan(number) else "-INF" if number < 0 else "INF"
    # 1e15 and below are exact integers, and shorter so
    return repr(int(number)) if number.is_integer() and abs(number) < 1e15 else repr(number)


def _written(attributes: Attributes) -> dict[str, str]:
    known = {name: text for name, text in attributes.items() if text is not None}
    # a character that XML cannot hold, in a doc, must not spoil the whole description
    return {name: _NO_XML.sub("\ufffd", text) for name, text in known.items()}


def add_units(root: Element, units: Iterable[Unit | None]) -> None:
    """Adds the element `UnitDefinitions` with each of these units once, if there is at least
    one.
    """
    known = {unit.text: unit for unit in units if unit is not None}
    if not known:
        return
    definitions = child(root, "UnitDefinitions")
    for text in sorted(known):
        described = child(definitions, "Unit", {"name": text})
        base = _base(known[text])
        if base is not None:
            child(described, "BaseUnit", base)


def _base(unit: Unit) -> dict[str, str] | None:
    """The attributes of FMI's `BaseUnit`: powers of SI units, and factor and offset with SI value =
    factor · value + offset. None for units that FMI cannot describe, such as m^0.5 and decibels.
    """
    # FMI's base units have integer powers
    if any(power != int(power) for power in unit.exponents):
        return None
    powers = zip(BASE_SYMBOLS, unit.exponents, strict=True)
    base = {symbol: str(int(power)) for symbol, power in powers if power}
    if "dB" in base:
        return None
    # FMI takes 1 and 0 where nothing is said
    if unit.scale != 1.0:
        base["factor"] = number_text(unit.scale)
    if unit.offset != 0.0:
        base["offset"] = number_text(unit.offset)
    return base


CAUSALITY: dict[VariableKind, tuple[str, str, str | None]] = {
    VariableKind.INPUT: ("input", "discrete", None),
    VariableKind.OUTPUT: ("output", "discrete", "calculated"),
    VariableKind.STATE: ("local", "discrete", "calculated"),
    VariableKind.PARAMETER: ("parameter", "tunable", "exact"),
    VariableKind.SAMPLES: ("parameter", "fixed", "exact"),
    VariableKind.FIRST: ("parameter", "fixed", "exact"),
}
"""Causality, variability and `initial` by kind of variable."""


def fmi2_description(facts: UnitFacts, sources: Sequence[str], guid: str) -> str:
    """The text of `modelDescription.xml` of FMI 2.0. `sources` are the names of the C files to
    compile, `guid` the hash that sources and description share.
    """
    variables = facts.variables
    root = element(
        "fmiModelDescription",
        {
            "fmiVersion": "2.0",
            "modelName": facts.model,
            "guid": guid,
            "description": facts.doc or None,
            "version": facts.identity,
            "generationTool": facts.made_by,
            "variableNamingConvention": naming(facts),
        },
    )
    simulation = child(
        root,
        "CoSimulation",
        {
            "modelIdentifier": facts.prefix,
            # a static model has no sample time: a step may be of any length
            "canHandleVariableCommunicationStepSize": _truth(facts.sample_time is None),
            "canNotUseMemoryManagementFunctions": "true",
            "canGetAndSetFMUstate": "true",
            "canSerializeFMUstate": "true",
            "providesDirectionalDerivative": _truth(facts.depends is not None),
        },
    )
    # FMI 2.0 lists sources here, FMI 3.0 in a file of its own
    files = child(simulation, "SourceFiles")
    for name in sources:
        child(files, "File", {"name": name})
    add_units(root, (variable.unit for variable in variables.all))
    add_log_categories(root)
    child(root, "DefaultExperiment", experiment(facts))
    listed = child(root, "ModelVariables")
    for variable in variables.all:
        _add_fmi2_variable(listed, variable, facts)
    status = _scalar(
        listed, variables.status, variables.status_reference, facts.status_doc, VariableKind.OUTPUT
    )
    child(status, "Integer")
    if variables.iterations is not None:
        reference = variables.iterations_reference
        count = _scalar(
            listed, variables.iterations, reference, ITERATIONS_DOC, VariableKind.OUTPUT
        )
        child(count, "Integer")
    _add_structure(root, facts)
    return xml_text(root)


def add_log_categories(root: Element) -> None:
    """Adds the element `LogCategories` with the categories of log messages, which both FMI versions
    share.
    """
    categories = child(root, "LogCategories")
    for name, meaning in LOG_CATEGORIES.items():
        child(categories, "Category", {"name": name, "description": meaning})


def naming(facts: UnitFacts) -> str:
    """FMI's name of the convention that all variable names follow: `structured` or `flat`."""
    names = [variable.name for variable in facts.variables.all]
    return "structured" if is_structured(names) else "flat"


def experiment(facts: UnitFacts) -> dict[str, str | None]:
    """The attributes of the element `DefaultExperiment`: start time, and the sample time as step
    size in seconds.
    """
    every = facts.sample_time
    return {"startTime": "0", "stepSize": None if every is None else number_text(every)}


def limits(variable: Variable) -> dict[str, str | None]:
    """The attributes `unit`, `min` and `max` of a variable, as text or None; both FMI versions have
    them.
    """
    low, high = variable.range or (-float("inf"), float("inf"))
    return {
        "unit": variable.unit and variable.unit.text,
        "min": number_text(low) if low > -float("inf") else None,
        "max": number_text(high) if high < float("inf") else None,
    }


def _add_fmi2_variable(listed: Element, variable: Variable, facts: UnitFacts) -> None:
    for offset, (name, doc) in enumerate(element_names(variable, facts.labels)):
        scalar = _scalar(listed, name, variable.first + offset, doc, variable.kind)
        # FMI forbids a start value where `initial` is calculated
        start = None if variable.kind.is_result else number_text(variable.start[offset])
        child(scalar, "Real", {**limits(variable), "start": start})


def _scalar(listed: Element, name: str, reference: int, doc: str, kind: VariableKind) -> Element:
    causality, variability, initial = CAUSALITY[kind]
    attributes = {
        "name": name,
        "valueReference": str(reference),
        "description": doc or None,
        "causality": causality,
        "variability": variability,
        "initial": initial,
    }
    return child(listed, "ScalarVariable", attributes)


def _add_structure(root: Element, facts: UnitFacts) -> None:
    """Adds the element `ModelStructure`: outputs with the inputs on which they depend in the same
    step. FMI 2.0 refers to variables by their place in the list, from 1.
    """
    structure = child(root, "ModelStructure")
    outputs, initial = child(structure, "Outputs"), child(structure, "InitialUnknowns")
    for variable in facts.variables.of(VariableKind.OUTPUT):
        places: str | None = None
        if facts.depends is not None:
            inputs = facts.depends[variable.name]
            # by places in the list, which begin with 1
            places = " ".join(str(i + 1) for v in inputs for i in range(v.first, v.first + v.size))
        for place in range(variable.first + 1, variable.first + variable.size + 1):
            # without slopes nothing is said of dependencies: that means all inputs
            child(outputs, "Unknown", {"index": str(place), "dependencies": places})
            child(initial, "Unknown", {"index": str(place)})
    behind = facts.variables.status_reference + 1
    counts = 1 if facts.variables.iterations is None else 2
    for place in range(behind, behind + counts):
        child(outputs, "Unknown", {"index": str(place)})
        child(initial, "Unknown", {"index": str(place)})


def _truth(value: bool) -> str:
    return "true" if value else "false"


def fmi3_description(facts: UnitFacts, token: str) -> str:
    """The text of `modelDescription.xml` of FMI 3.0. `token` is the hash that sources and
    description share.
    """
    variables = facts.variables
    root = element(
        "fmiModelDescription",
        {
            "fmiVersion": "3.0",
            "modelName": facts.model,
            "instantiationToken": token,
            "description": facts.doc or None,
            "version": facts.identity,
            "generationTool": facts.made_by,
            "variableNamingConvention": naming(facts),
        },
    )
    every = facts.sample_time
    child(
        root,
        "CoSimulation",
        {
            "modelIdentifier": facts.prefix,
            "canHandleVariableCommunicationStepSize": "true" if every is None else "false",
            # FMI 3.0: steps of an importer are whole multiples of this one
            "fixedInternalStepSize": None if every is None else number_text(every),
            "canGetAndSetFMUState": "true",
            "canSerializeFMUState": "true",
            "providesDirectionalDerivatives": "false" if facts.depends is None else "true",
        },
    )
    add_units(root, (variable.unit for variable in variables.all))
    add_log_categories(root)
    child(root, "DefaultExperiment", experiment(facts))
    listed = child(root, "ModelVariables")
    for variable in variables.all:
        _add_fmi3_variable(listed, variable, facts)
    _add_own(listed, facts)
    structure = child(root, "ModelStructure")
    for variable in variables.of(VariableKind.OUTPUT):
        known = None if facts.depends is None else facts.depends[variable.name]
        # without the attribute it may depend on everything, with an empty one on nothing
        places = None if known is None else " ".join(str(input.first) for input in known)
        reference = {"valueReference": str(variable.first)}
        child(structure, "Output", {**reference, "dependencies": places})
    # without `dependencies`: a status may depend on everything
    counts = [{"valueReference": str(variables.status_reference)}]
    if variables.iterations is not None:
        counts.append({"valueReference": str(variables.iterations_reference)})
    for count in counts:
        child(structure, "Output", count)
    for variable in variables.of(VariableKind.OUTPUT):
        child(structure, "InitialUnknown", {"valueReference": str(variable.first)})
    for count in counts:
        child(structure, "InitialUnknown", count)
    return xml_text(root)


def build_text(prefix: str, sources: Sequence[str]) -> str:
    """The text of `sources/buildDescription.xml` of FMI 3.0, from which importers compile a unit.
    `prefix` is the model identifier, `sources` are the names of the C files.
    """
    root = element("fmiBuildDescription", {"fmiVersion": "3.0"})
    build = child(root, "BuildConfiguration", {"modelIdentifier": prefix})
    files = child(
        build, "SourceFileSet", {"language": "C99", "compilerOptions": "-ffp-contract=off"}
    )
    for name in sources:
        child(files, "SourceFile", {"name": name})
    child(build, "Library", {"name": "m", "external": "true"})
    return xml_text(root)


def _add_fmi3_variable(listed: Element, variable: Variable, facts: UnitFacts) -> None:
    causality, variability, initial = CAUSALITY[variable.kind]
    start = None
    if not variable.kind.is_result:
        start = " ".join(number_text(value) for value in variable.start)
    attributes = {
        "name": variable.name,
        "valueReference": str(variable.first),
        "description": variable.doc or None,
        "causality": causality,
        "variability": variability,
        "initial": initial,
        **limits(variable),
        "start": start,
    }
    found = child(listed, _type(facts), attributes)
    # one dimension each, in C order, as the standard's
    for size in variable.shape:
        child(found, "Dimension", {"start": str(size)})


def _add_own(listed: Element, facts: UnitFacts) -> None:
    """Adds the variables that do not come from the spec to the list of FMI 3.0: status, iterations
    if there are any, and time.
    """
    variables = facts.variables
    _add_count(listed, variables.status, variables.status_reference, facts.status_doc)
    if variables.iterations is not None:
        _add_count(listed, variables.iterations, variables.iterations_reference, ITERATIONS_DOC)
    # FMI 3.0 wants the independent variable listed; version 2.0 knows time without
    attributes = {
        "name": variables.time,
        "valueReference": str(variables.time_reference),
        "description": "seconds",
        "causality": "independent",
        "variability": "continuous",
    }
    child(listed, "Float64", attributes)


def _add_count(listed: Element, name: str, reference: int, doc: str) -> None:
    causality, variability, initial = CAUSALITY[VariableKind.OUTPUT]
    attributes = {
        "name": name,
        "valueReference": str(reference),
        "description": doc,
        "causality": causality,
        "variability": variability,
        "initial": initial,
    }
    child(listed, "UInt32", attributes)


def _type(facts: UnitFacts) -> str:
    return "Float32" if facts.dtype == "float32" else "Float64"

"""Writes the FMI 3.0 descriptions of the model, with whole arrays, and of its build."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree.ElementTree import Element

from backends.fmu.description.description2 import (
    CAUSALITY,
    add_log_categories,
    experiment,
    limits,
    naming,
)
from backends.fmu.description.facts import ITERATIONS_DOC, UnitFacts
from backends.fmu.description.units import add_units
from backends.fmu.description.variable import Variable, VariableKind
from backends.fmu.description.xml_text import child, element, number_text, xml_text


def description_text(facts: UnitFacts, token: str) -> str:
    """The text of `modelDescription.xml`."""
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
        _add(listed, variable, facts)
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
    """The text of `sources/buildDescription.xml`."""
    root = element("fmiBuildDescription", {"fmiVersion": "3.0"})
    build = child(root, "BuildConfiguration", {"modelIdentifier": prefix})
    files = child(
        build, "SourceFileSet", {"language": "C99", "compilerOptions": "-ffp-contract=off"}
    )
    for name in sources:
        child(files, "SourceFile", {"name": name})
    child(build, "Library", {"name": "m", "external": "true"})
    return xml_text(root)


def _add(listed: Element, variable: Variable, facts: UnitFacts) -> None:
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
    """Adds the variables that do not come from the spec."""
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

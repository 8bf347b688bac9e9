"""Writes the model description of FMI 2.0, in which every element is a separate variable."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree.ElementTree import Element

from backends.fmu.description.facts import ITERATIONS_DOC, LOG_CATEGORIES, UnitFacts
from backends.fmu.description.names import element_names, is_structured
from backends.fmu.description.units import add_units
from backends.fmu.description.variable import Variable, VariableKind
from backends.fmu.description.xml_text import child, element, number_text, xml_text

CAUSALITY: dict[VariableKind, tuple[str, str, str | None]] = {
    VariableKind.INPUT: ("input", "discrete", None),
    VariableKind.OUTPUT: ("output", "discrete", "calculated"),
    VariableKind.STATE: ("local", "discrete", "calculated"),
    VariableKind.PARAMETER: ("parameter", "tunable", "exact"),
    VariableKind.SAMPLES: ("parameter", "fixed", "exact"),
    VariableKind.FIRST: ("parameter", "fixed", "exact"),
}
"""Causality, variability and `initial` by kind of variable."""


def description_text(facts: UnitFacts, sources: Sequence[str], guid: str) -> str:
    """The text of `modelDescription.xml`; `sources` are the files to compile."""
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
        _add(listed, variable, facts)
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
    """Adds the categories of log messages, which are the same in both versions."""
    categories = child(root, "LogCategories")
    for name, meaning in LOG_CATEGORIES.items():
        child(categories, "Category", {"name": name, "description": meaning})


def naming(facts: UnitFacts) -> str:
    """The FMI naming convention that the names of all variables follow."""
    names = [variable.name for variable in facts.variables.all]
    return "structured" if is_structured(names) else "flat"


def experiment(facts: UnitFacts) -> dict[str, str | None]:
    """Attributes of `DefaultExperiment`."""
    every = facts.sample_time
    return {"startTime": "0", "stepSize": None if every is None else number_text(every)}


def limits(variable: Variable) -> dict[str, str | None]:
    """Attributes with limits and unit that both versions share."""
    low, high = variable.range or (-float("inf"), float("inf"))
    return {
        "unit": variable.unit and variable.unit.text,
        "min": number_text(low) if low > -float("inf") else None,
        "max": number_text(high) if high < float("inf") else None,
    }


def _add(listed: Element, variable: Variable, facts: UnitFacts) -> None:
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
    """Adds the outputs and their dependencies; indices into the list of variables start at 1."""
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

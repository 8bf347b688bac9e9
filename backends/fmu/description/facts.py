"""Holds what the descriptions of a unit say beside its variables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from backends.c_language.literals import Dtype
from backends.fmu.description.variable import UnitVariables, Variable

ERROR, WARNING = "logStatusError", "logStatusWarning"
"""Categories of messages; the names are FMI's."""

LOG_CATEGORIES = {ERROR: "what was refused, and why", WARNING: "status bits that a step has set"}

ITERATIONS_DOC = "that the last step took"


@dataclass(frozen=True, slots=True, kw_only=True)
class UnitFacts:
    """One model as both versions of FMI describe it."""

    model: str
    made_by: str
    """The version of msnn, and of the plug-ins of the spec."""
    identity: str
    """The version of the model: a hash of its C, weights and options among it."""
    prefix: str
    """The identifier of the model: names of functions and files."""
    doc: str
    dtype: Dtype
    sample_time: float | None
    """Seconds; None for a static model, whose steps may be of any length."""
    variables: UnitVariables
    labels: Mapping[str, Sequence[str]]
    """Of the elements of dimensions."""
    depends: Mapping[str, Sequence[Variable]] | None
    """The inputs that each output depends on in the same step; None where no slopes are there."""
    status_doc: str
    """What the numbers of the status mean."""

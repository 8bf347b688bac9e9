"""Defines the contents of a unit's description besides its variables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from backends.c_language.literals import Dtype
from backends.fmu.description.variable import UnitVariables, Variable

ERROR, WARNING = "logStatusError", "logStatusWarning"
"""Categories of log messages, with FMI's names."""

LOG_CATEGORIES = {ERROR: "what was refused, and why", WARNING: "status bits that a step has set"}

ITERATIONS_DOC = "that the last step took"


@dataclass(frozen=True, slots=True, kw_only=True)
class UnitFacts:
    """The description of one model, used by both versions of FMI."""

    model: str
    made_by: str
    """The version of msnn, and of the plug-ins that the spec uses."""
    identity: str
    """The version of the model: a hash of C code, weights and options."""
    prefix: str
    """The model identifier, the prefix of functions and files."""
    doc: str
    dtype: Dtype
    sample_time: float | None
    """In seconds; None for a static model, whose steps may have any length."""
    variables: UnitVariables
    labels: Mapping[str, Sequence[str]]
    """Labels of the elements of each dimension, by name of the dimension."""
    depends: Mapping[str, Sequence[Variable]] | None
    """The inputs on which each output depends in the same step; None if there is no Jacobian."""
    status_doc: str
    """The meaning of the status values."""

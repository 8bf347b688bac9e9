"""All that a plug-in imports of msnn, by one name in the checkout and in the wheel.

docs/extending.md shows how to write, install and test a plug-in.
"""

from __future__ import annotations

from compiler.elaboration.section import CompiledSection, CompileOther, Section, SectionProblem
from compiler.ir.program import Program
from compiler.linking.link import Linked
from msnn.exports.prepare import float_plan, step_program
from msnn.exports.target import ExportPlan, Request, Target, Weights, Written
from msnn.model.model import Model
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError, error, remark, warning
from spec_schema.diagnostics.source import Span
from spec_schema.fields.entry import Entry, OneOf
from spec_schema.fields.formulas import ExpressionField
from spec_schema.fields.late_entry import LateEntry, LateObject
from spec_schema.fields.located import Located
from spec_schema.fields.plain import (
    EntriesOf,
    ManyOf,
    NewName,
    NonNegativeCount,
    NonNegativeNumber,
    PositiveCount,
    PositiveNumber,
    Reference,
    References,
    Switch,
    Text,
    choice,
)
from spec_schema.fields.quantities import QuantityField, RangeField, UnitField
from spec_schema.registry import Feature, SectionLine, TargetLine
from spec_schema.sections.exports import FloatTargetEntry, TargetEntry
from spec_schema.sections.spec import Spec

__all__ = [
    "CompileOther",
    "CompiledSection",
    "Diagnostic",
    "EntriesOf",
    "Entry",
    "ExportPlan",
    "ExpressionField",
    "Feature",
    "FloatTargetEntry",
    "LateEntry",
    "LateObject",
    "Linked",
    "Located",
    "ManyOf",
    "Model",
    "NewName",
    "NonNegativeCount",
    "NonNegativeNumber",
    "OneOf",
    "PositiveCount",
    "PositiveNumber",
    "Program",
    "QuantityField",
    "RangeField",
    "Reference",
    "References",
    "Request",
    "Section",
    "SectionLine",
    "SectionProblem",
    "Span",
    "Spec",
    "SpecError",
    "Switch",
    "Target",
    "TargetEntry",
    "TargetLine",
    "Text",
    "UnitField",
    "Weights",
    "Written",
    "choice",
    "error",
    "float_plan",
    "remark",
    "step_program",
    "warning",
]
